"""Lengths as the scene's units say them: in the panel, the legend, the statistics and messages.  Needs no NumPy."""

from __future__ import annotations

from bpy.types import Scene

UNITS = {
    "KILOMETERS": ("km", 1e-3), "METERS": ("m", 1.0), "CENTIMETERS": ("cm", 1e2), "MILLIMETERS": ("mm", 1e3),
    "MICROMETERS": ("µm", 1e6), "MILES": ("mi", 1 / 1609.344), "FEET": ("ft", 1 / 0.3048),
    "INCHES": ("in", 1 / 0.0254), "THOU": ("thou", 1000 / 0.0254),
}  # fmt: skip
"""Short name of each of Blender's units, and its number in one metre."""

ADAPTIVE = {
    "METRIC": ("KILOMETERS", "METERS", "MILLIMETERS", "MICROMETERS"),
    "IMPERIAL": ("MILES", "FEET", "INCHES", "THOU"),
}
"""The units to choose from by the size of a length, where the scene names none."""


def unit_for(scene: Scene, length: float) -> tuple[str, float]:
    """Return the short name of the unit in which the scene shows a length, and that unit's number in one Blender unit.

    The name is empty where the scene has no units.  `bpy.utils.units.to_string` knows neither the unit that a scene
    names nor the significant digits that an error needs.
    """
    settings = scene.unit_settings
    if settings.system == "NONE":
        return "", 1.0
    metres = settings.scale_length
    if settings.length_unit in UNITS:
        name, factor = UNITS[settings.length_unit]
        return name, factor * metres
    offered = [UNITS[each] for each in ADAPTIVE[settings.system]]
    name, factor = next((unit for unit in offered if abs(length) * unit[1] * metres > 0.9999), offered[-1])
    if length == 0.0:
        name, factor = offered[1]
    return name, factor * metres


def length_text(scene: Scene, length: float, digits: int = 4) -> str:
    """Return a length given in Blender units as the scene shows it, such as `1.234 mm`."""
    name, factor = unit_for(scene, length)
    return f"{length * factor:.{digits}g} {name}".rstrip()

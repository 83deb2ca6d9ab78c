"""What the panels for representations and comparisons remember (`scene.sparse_surface.inspection`, `.comparison`)."""

import zlib

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)
from bpy.types import Context, Object, PropertyGroup

from ..operators.data.noise_key import set_strength, strength
from ..operators.data.presets import preset_names, preset_title
from ..operators.measure.options import how_to_measure
from ..solver.settings import MOST_SPLITS, PRESETS


class SparseSurfaceTerm(PropertyGroup):
    """A function that the inspected patch uses, with its coefficients."""

    name: StringProperty(name="Function")
    amounts: FloatVectorProperty(name="Coefficients", description="In x, y and z, in scene units", size=3)


class SparseSurfaceEnergy(PropertyGroup):
    """A patch's energy after one iteration, relative to the first."""

    value: FloatProperty(name="Energy")


def _strength(inspection: PropertyGroup) -> float:
    """The strength of the active result."""
    made = bpy.context.active_object
    return 1.0 if made is None else strength(made)


def _set_strength(inspection: PropertyGroup, share: float) -> None:
    if (made := bpy.context.active_object) is not None:
        set_strength(made, share)


class SparseSurfaceInspection(PropertyGroup):
    """The patch that is shown, and how the active result is."""

    patch: IntProperty(name="Patch", description="Number of the patch, as in the attribute 'patch'", default=0, min=0)
    splits: IntProperty(
        name="Splits",
        description="Number of parts of every edge. The number of faces grows with its square",
        default=2,
        min=1,
        max=MOST_SPLITS,
        soft_max=8,
    )
    strength: FloatProperty(
        name="Strength",
        description="How much of the noise that was found the active result is seen without: 0 none, 1 all. Changes it "
        "at once, by its shape key Noise, and solves nothing; figures and colours remain those of 1",
        min=0.0,
        max=1.0,
        default=1.0,
        subtype="FACTOR",
        get=_strength,
        set=_set_strength,
        options={"SKIP_SAVE"},
    )
    holder: StringProperty(name="Result", description="Name of the result whose patch is shown")
    patches: IntProperty(name="Patches")
    vertices: IntProperty(name="Vertices")
    terms: CollectionProperty(type=SparseSurfaceTerm, name="Functions")
    term: IntProperty(name="Function")
    energy: CollectionProperty(type=SparseSurfaceEnergy, name="Energy")


def preset_number(name: str) -> int:
    """Return the number of a preset in an enumeration: Blender stores it, so a user's does not depend on the others."""
    shipped = list(PRESETS)
    return shipped.index(name) if name in shipped else 1000 + zlib.crc32(name.encode()) % 2**30


_offered: list[tuple[str, str, str, int]] = []
"""Blender needs the words of an enumeration to stay alive."""


def _choices(comparison: PropertyGroup, context: Context | None) -> list[tuple[str, str, str, int]]:
    """The panel's own settings, and each preset."""
    presets = [(f"PRESET_{name}", preset_title(name), "A preset", 1 + preset_number(name)) for name in preset_names()]
    _offered[:] = [("SCENE", "Settings of the Panel", "The settings as they stand in the panel", 0), *presets]
    return _offered


class SparseSurfaceComparison(PropertyGroup):
    """The two settings to compare."""

    first: EnumProperty(name="First", description="Settings of the result at the left", items=_choices, default=0)
    second: EnumProperty(name="Second", description="Settings of the result at the right", items=_choices, default=2)
    beside: BoolProperty(
        name="Side by Side", description="Put the results beside each other; otherwise both stay in place", default=True
    )


def _can_be_measured(measurement: PropertyGroup, candidate: Object) -> bool:
    return candidate.type in {"MESH", "POINTCLOUD"}


class SparseSurfaceMeasurement(PropertyGroup):
    """How distances are measured; what the operator asks, too, is added below."""

    reference: PointerProperty(
        type=Object,
        name="Reference",
        description="What all selected objects are measured against. "
        "Without one the active of two selected objects is measured against the other",
        poll=_can_be_measured,
    )


SparseSurfaceMeasurement.__annotations__.update(how_to_measure())

CLASSES = (
    SparseSurfaceTerm,
    SparseSurfaceEnergy,
    SparseSurfaceInspection,
    SparseSurfaceComparison,
    SparseSurfaceMeasurement,
)

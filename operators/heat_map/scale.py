"""How errors become colours: the scene's display settings applied to objects with a heat map."""

from __future__ import annotations

from typing import Any

import numpy as np
from bpy.types import Object, PropertyGroup, Scene
from numpy.typing import NDArray

from ..data.attributes import read
from ..data.colours import ColourScale
from ..data.result_keys import ERROR, has_heat_map
from ..data.results import write_error


def colour_scale(scene: Scene, errors: NDArray[np.floating[Any]]) -> ColourScale:
    """Return the scale that the scene's display settings ask for; it is even around zero if errors have signs."""
    signed = bool((errors < 0.0).any())
    errors = np.abs(errors)
    display = scene.sparse_surface.display
    if display.range_mode == "FIXED":
        high = display.range_maximum
    elif display.range_mode == "PERCENTILE":
        high = float(np.percentile(errors, display.range_percentile)) if len(errors) else 0.0
    else:
        high = float(errors.max(initial=0.0))
    return ColourScale(-high if signed else 0.0, high, shown_tolerance(scene))


def shown_tolerance(scene: Scene) -> float:
    """Return the tolerance that separates inside from outside, 0 where errors are shown on the ramp."""
    settings: PropertyGroup = scene.sparse_surface
    if not settings.display.inside_outside:
        return 0.0
    return settings.tolerance or settings.display.tolerance


def recolour(coloured: Object, scene: Scene) -> None:
    """Give an object's errors the colours of the scene's display settings."""
    errors = read(coloured.data, ERROR)
    write_error(coloured, errors, colour_scale(scene, errors))


def recolour_scene(scene: Scene) -> None:
    """Recolour every object of a scene that has a heat map and can be written."""
    for candidate in scene.objects:
        if has_heat_map(candidate) and candidate.data.is_editable and candidate.mode == "OBJECT":
            recolour(candidate, scene)

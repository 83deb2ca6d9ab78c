"""How errors become colours: the scene's display settings applied to objects with a heat map."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from bpy.types import Context, Object, Scene
from numpy.typing import NDArray

from ...solver.approximation.parts import taken_apart
from ...solver.errors import InputError
from ..data.attributes import read, show_colours
from ..data.colours import ColourScale
from ..data.objects import current_name, parts_of
from ..data.origins import COMPARED, ROLE, SOURCE
from ..data.overlaid import hide_overlaid
from ..data.parts import share_functions
from ..data.result_keys import (
    EARLY,
    ERROR,
    ERROR_COLOUR,
    PATCH_COLOUR,
    SCALE,
    WITH_MODIFIERS,
    has_heat_map,
    shows_patches,
)
from ..data.results import create_result, write_error
from .shown import anywhere_shown, choose_colours, shown_tolerance

if TYPE_CHECKING:
    from ...solver.approximation.result import Approximation
    from ..data.meshes import Source
    from ..data.parts import Parts


def colour_scale(scene: Scene, errors: NDArray[np.floating[Any]], *, signed: bool = False) -> ColourScale:
    """Return the scale that the scene's display settings ask for; it is even around zero if errors have signs."""
    signed = signed or bool((errors < 0.0).any())
    errors = np.abs(errors)
    display = scene.sparse_surface.display
    if display.range_mode == "FIXED":
        high = display.range_maximum
    elif display.range_mode == "PERCENTILE":
        high = float(np.percentile(errors, display.range_percentile)) if len(errors) else 0.0
    else:
        high = float(errors.max(initial=0.0))
    return ColourScale(-high if signed else 0.0, high, shown_tolerance(scene))


def create_coloured(
    context: Context, source: Source | Parts, result: Approximation, refusals: list[str], *, replace: bool
) -> list[Object]:
    """Make the result object of each source on the scene's scale; with `replace` in the place of an earlier one.

    Parts of one surface hold no functions, which describe the whole: they share them.  For a source that was removed or
    edited since it was read there is a sentence in `refusals` instead.
    """
    scale, parts = colour_scale(context.scene, result.error), parts_of(source)
    results, names = [result], [current_name(part) for part in parts]
    if len(parts) > 1:
        results = taken_apart(result, [part.arrays for part in parts], names)
    made: list[Object | None] = []
    for part, own in zip(parts, results, strict=True):
        try:
            each = create_result(context, part, own, scale, replace=replace, keeps_functions=len(parts) == 1)
        except InputError as error:
            refusals.append(str(error))
            made.append(None)
            continue
        each[WITH_MODIFIERS] = part.evaluated
        made.append(each)
    if len(parts) > 1:
        share_functions(made, parts, result.representation.draft)
    found = [each for each in made if each is not None]
    hide_overlaid(found, context)
    return found


def recolour_scene(scene: Scene) -> None:
    """Recolour every object of a scene that has a heat map and can be written.

    While a viewport shows heat maps, those that are visible share one scale, so that equal colours are equal errors.
    The two results of a comparison always do.
    """
    errors = {
        candidate: read(candidate.data, ERROR)
        for candidate in scene.objects
        if has_heat_map(candidate) and candidate.data.is_editable and candidate.mode == "OBJECT"
    }
    together = [each for each in errors if EARLY not in each and each.visible_get()] if anywhere_shown() else []
    shared = _common_scale(scene, {each: errors[each] for each in together}) if together else None
    for coloured, own in errors.items():
        patches = shows_patches(coloured)
        pair = [each for each in errors if _are_compared(each, coloured)] or [coloured]
        scale = _common_scale(scene, {each: errors[each] for each in pair})
        if shared is not None and coloured in together:
            scale = shared
        if list(coloured[SCALE]) != [scale.low, scale.high, scale.tolerance]:
            write_error(coloured, own, scale)
            if patches:
                show_colours(coloured.data, PATCH_COLOUR)
        if coloured in together and not patches:
            choose_colours(coloured, ERROR_COLOUR)


def _common_scale(scene: Scene, errors: dict[Object, NDArray[np.floating[Any]]]) -> ColourScale:
    """Return one scale for several objects; distances that were measured with signs keep a place for both."""
    signed = any(each[SCALE][0] < 0.0 for each in errors)
    return colour_scale(scene, np.concatenate(list(errors.values())), signed=signed)


def _are_compared(one: Object, other: Object) -> bool:
    """Whether two objects are what Compare Methods has made of one source, or the same of them."""
    both = one.get(ROLE) in COMPARED and other.get(ROLE) in COMPARED
    return both and one.get(SOURCE) == other.get(SOURCE)

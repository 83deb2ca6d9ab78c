"""Two results of one mesh, beside each other on one colour scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from bpy.types import Context, Object

from ..data.colours import ColourScale
from ..data.objects import current_name
from ..data.origins import COMPARED
from ..data.result_keys import WITH_MODIFIERS, cut_name, result_name
from ..data.results import create_result
from ..data.viewports import frame
from ..data.visibility import stand_beside
from .scale import colour_scale, recolour_scene
from .shown import show_here

if TYPE_CHECKING:
    from ...solver.approximation.result import Approximation

Solved = tuple[Any, Any]
"""A `Source` with its `Approximation`."""


def compare_pair(context: Context, done: Sequence[Solved], first: str, second: str, *, beside: bool) -> list[Object]:
    """Make the objects of two results on the scale that the scene's display settings ask for.

    Parameters
    ----------
    done
        The same source with both results.
    first, second
        Choices of `SparseSurfaceComparison`.

    Raises
    ------
    SparseSurfaceError
        When the source was removed or edited since it was read.
    """
    scale = colour_scale(context.scene, np.concatenate([result.error for _, result in done]))
    titles = [_title(choice, result) for choice, (_, result) in zip((first, second), done, strict=True)]
    replace = context.scene.sparse_surface.replace_result
    return make_pair(context, done, titles, scale, beside=beside, replace=replace)


def make_pair(
    context: Context,
    done: Sequence[Solved],
    titles: Sequence[str],
    scale: ColourScale,
    *,
    beside: bool,
    replace: bool = False,
) -> list[Object]:
    """Make the result objects of one source, coloured with one scale and named after `titles`.

    With `beside` they stand at the source's right; otherwise where the source stands.  With `replace` they take the
    place of earlier ones.

    Raises
    ------
    SparseSurfaceError
        When the source was removed or edited since it was read.
    """
    made = []
    for place, ((source, result), title, role) in enumerate(zip(done, titles, COMPARED, strict=True), 1):
        shown = create_result(context, source, result, scale, role=role, replace=replace)
        shown.name = cut_name(result_name(current_name(source)), f" {place} {title}")
        shown.data.name = shown.name
        shown[WITH_MODIFIERS] = source.evaluated
        if beside:
            stand_beside([shown], context, place)
        made.append(shown)
    return made


def show_pair(made: Sequence[Object], context: Context) -> None:
    """Show the heat map of both where the user looks, and all of both."""
    show_here(context)
    recolour_scene(context.scene)
    frame(made, context)


def _title(choice: str, result: Approximation) -> str:
    method: str = result.report["settings"]["method"]
    return (method if choice == "SCENE" else choice.removeprefix("PRESET_")).title()

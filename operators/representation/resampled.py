"""A result's surface evaluated on a finer mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from bpy.types import Context, Object
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ...solver.approximation.parts import Part
from ...solver.progress import run_to_end
from ...solver.surface.representation import Representation
from ...solver.surface.resampling import Resampled, resample_steps
from ..data.attributes import read
from ..data.colours import ColourScale
from ..data.meshes import WorldLengths, create_mesh, loose_edges, mark_sharp, read_positions
from ..data.objects import create_object
from ..data.origins import RESAMPLED
from ..data.result_keys import ERROR, SCALE, SPLITS, cut_name, stored_numbers
from ..data.results import write_error
from ..heat_map.scale import colour_scale
from .carried_layers import carry_layers
from .stored import place_parts, placement, read_representation


def resample_object(context: Context, holder: Object, splits: int, *, replace: bool = False) -> Object:
    """Make the resampled object of a result; with `replace` in the place of an earlier one.

    Raises
    ------
    SparseSurfaceError
        When the object holds no representation, its mesh was edited, or the new one would be too large.
    """
    representation = read_representation(holder)
    place = placement(holder, representation)
    resampled = _resampled(context, representation, splits)
    on_source = SPLITS not in holder  # a reconstructed surface is finer than the mesh of its representation
    loose = place.vertex[loose_edges(holder.data)] if on_source else None
    local = place.to_local(resampled.vertices)
    made = _created(context, holder, resampled, local, loose, replace)
    error: NDArray[np.floating[Any]]
    if on_source:
        carry_layers(holder, made, resampled, place.vertex)
        error = np.linalg.norm(resampled.vertices - resampled.at_vertices.linear(representation.vertices), axis=1)
    else:  # the error of the nearest vertex of the reconstructed surface
        error = read(holder.data, ERROR)[cKDTree(read_positions(holder.data)).query(local)[1]]
    _colour(context, made, holder, error)
    return made


def resample_shared(
    context: Context, holders: Sequence[Object], splits: int, *, replace: bool = False
) -> tuple[list[Object], int]:
    """Make the resampled objects of results that share their functions, so that they meet at their common borders.

    Parts that were edited are left out.

    Parameters
    ----------
    holders
        The results, parts of one surface.
    replace
        Whether earlier ones are replaced.

    Returns
    -------
    made, left_out
        The objects, that of the last result last, and how many results were edited.

    Raises
    ------
    SparseSurfaceError
        When the last of them was edited, the functions are damaged, or the mesh would be too large.
    """
    representation = read_representation(holders[-1])
    placed = place_parts(holders, representation)
    parts = [(holder, part, place.to_local) for holder, part, place in placed]
    return _resampled_parts(context, parts, representation, splits, replace), len(holders) - len(placed)


def resample_parts(
    context: Context, holders: Sequence[Object], parts: Sequence[Part], representation: Representation, splits: int
) -> list[Object]:
    """Make the resampled objects of results that are parts of one surface; raises `InputError` where too large."""
    scales = [WorldLengths.of_matrix(holder.matrix_world).to_local for holder in holders]
    return _resampled_parts(context, list(zip(holders, parts, scales, strict=True)), representation, splits)


def _resampled_parts(
    context: Context,
    parts: Sequence[tuple[Object, Part, Callable[[Any], NDArray[np.float32]]]],
    representation: Representation,
    splits: int,
    replace: bool = False,
) -> list[Object]:
    whole, made = _resampled(context, representation, splits), []
    away = np.linalg.norm(whole.vertices - whole.at_vertices.linear(representation.vertices), axis=1)
    for holder, part, to_local in parts:
        own, kept = whole.part(part.faces, part.corners, part.place)
        first = np.sort(np.unique(part.place, return_index=True)[1])
        number = np.full(len(representation.vertices), -1)
        number[part.place[first]] = np.arange(len(first))
        vertex = number[part.place]
        loose = vertex[loose_edges(holder.data)]
        made.append(_created(context, holder, own, to_local(own.vertices), loose, replace))
        carry_layers(holder, made[-1], own, vertex)
        _colour(context, made[-1], holder, away[kept])
    return made


def _created(
    context: Context,
    holder: Object,
    resampled: Resampled,
    local: NDArray[np.float32],
    loose: NDArray[np.int64] | None,
    replace: bool = False,
) -> Object:
    """Make the object, at local positions (P, 3), with edges of no face."""
    name = cut_name(holder.name, " Resampled")
    mesh = create_mesh(name, local, resampled.corners, resampled.sizes, loose)
    mark_sharp(mesh, resampled.creases)
    return create_object(name, mesh, holder, context, role=RESAMPLED, replace=replace)


def _colour(context: Context, made: Object, holder: Object, error: NDArray[np.floating[Any]]) -> None:
    """Write errors and their colours on the scale of the result, so that both can be compared."""
    numbers = stored_numbers(holder, SCALE, 3)
    write_error(made, error, ColourScale(*numbers) if numbers else colour_scale(context.scene, error))


def _resampled(context: Context, representation: Any, splits: int) -> Resampled:
    manager = context.window_manager
    manager.progress_begin(0.0, 1.0)
    try:
        return run_to_end(resample_steps(representation, splits), lambda step: manager.progress_update(step.fraction))
    finally:
        manager.progress_end()

"""A result's surface evaluated on a finer mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
from bpy.types import Context, Object
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ...solver.progress import run_to_end
from ...solver.surface.resampling import Resampled, resample_steps
from ..data.attributes import read
from ..data.colours import ColourScale
from ..data.meshes import create_mesh, loose_edges, mark_sharp, read_positions
from ..data.objects import create_object
from ..data.origins import RESAMPLED
from ..data.result_keys import ERROR, SCALE, SPLITS, cut_name, stored_numbers
from ..data.results import write_error
from ..heat_map.scale import colour_scale
from .carried_layers import carry_layers
from .stored import placement, read_representation


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
    name = cut_name(holder.name, " Resampled")
    on_source = SPLITS not in holder  # a reconstructed surface is finer than the mesh of its representation
    loose = place.vertex[loose_edges(holder.data)] if on_source else None
    local = place.to_local(resampled.vertices)
    mesh = create_mesh(name, local, resampled.corners, resampled.sizes, loose)
    mark_sharp(mesh, resampled.creases)
    made = create_object(name, mesh, holder, context, role=RESAMPLED, replace=replace)
    error: NDArray[np.floating[Any]]
    if on_source:
        carry_layers(holder, made, resampled, place.vertex)
        error = np.linalg.norm(resampled.vertices - resampled.at_vertices.linear(representation.vertices), axis=1)
    else:  # the error of the nearest vertex of the reconstructed surface
        error = read(holder.data, ERROR)[cKDTree(read_positions(holder.data)).query(local)[1]]
    # The same scale as that of the result, so that both can be compared.
    numbers = stored_numbers(holder, SCALE, 3)
    scale = ColourScale(*numbers) if numbers else colour_scale(context.scene, error)
    write_error(made, error, scale)
    return made


def _resampled(context: Context, representation: Any, splits: int) -> Resampled:
    manager = context.window_manager
    manager.progress_begin(0.0, 1.0)
    try:
        return run_to_end(resample_steps(representation, splits), lambda step: manager.progress_update(step.fraction))
    finally:
        manager.progress_end()

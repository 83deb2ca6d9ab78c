"""The heat map of the difference between two meshes of the same topology."""

from __future__ import annotations

import numpy as np
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Object
from numpy.typing import NDArray

from ...solver.errors import InputError
from ...solver.interchange import MeshArrays
from ..data.meshes import read_mesh, read_positions, same_topology, to_world
from ..data.results import write_error
from ..data.visibility import readable
from .scale import colour_scale


def write_difference(context: Context, coloured: Object, other: Object) -> float:
    """Write the distances of corresponding vertices in the world as errors of `coloured`; return the largest.

    Both meshes are taken as modifiers leave them.

    Raises
    ------
    InputError
        When the meshes' polygons differ, or modifiers of `coloured` change its polygons: its errors could not be
        stored.
    """
    (arrays, here), (others, there) = (_as_seen(each, context) for each in (coloured, other))
    if not same_topology(arrays, coloured.data):
        text = rpt_("The modifiers of '{}' change its polygons; apply them first, or make the other mesh active.")
        raise InputError(text.format(coloured.name))
    if not same_topology(others, coloured.data):
        raise InputError(rpt_("'{}' and '{}' do not have the same polygons.").format(coloured.name, other.name))
    error = np.linalg.norm(here - there, axis=1)
    write_error(coloured, error, colour_scale(context.scene, error))
    return float(error.max(initial=0.0))


def _as_seen(placed: Object, context: Context) -> tuple[MeshArrays, NDArray[np.float64]]:
    """Return an object's mesh after modifiers, and its vertices in the world (V, 3)."""
    with readable([placed], context):
        evaluated = placed.evaluated_get(context.evaluated_depsgraph_get())
        mesh = evaluated.to_mesh()
        try:
            return read_mesh(mesh), to_world(evaluated, read_positions(mesh))
        finally:
            evaluated.to_mesh_clear()

"""The heat map of the difference between two meshes of the same topology."""

from __future__ import annotations

import numpy as np
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Object

from ...solver.errors import InputError
from ..data.meshes import read_mesh, read_positions, same_topology, to_world
from ..data.results import write_error
from .scale import colour_scale


def write_difference(context: Context, coloured: Object, other: Object) -> float:
    """Write the distances of corresponding vertices in the world as errors of `coloured`; return the largest.

    Raises
    ------
    InputError
        When the meshes' polygons differ.
    """
    if not same_topology(read_mesh(other.data), coloured.data):
        raise InputError(rpt_("'{}' and '{}' do not have the same polygons.").format(coloured.name, other.name))
    here, there = (to_world(each, read_positions(each.data)) for each in (coloured, other))
    error = np.linalg.norm(here - there, axis=1)
    write_error(coloured, error, colour_scale(context.scene, error))
    return float(error.max(initial=0.0))

"""Values read off a heat map with the mouse: which vertex is under it, its value, and the point measured against.

What was read is kept as plain numbers, so that undo, edits and deleted objects do no harm.
"""

from __future__ import annotations

import numpy as np
from bpy.types import Context, Object
from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d
from mathutils import Vector

from ..data.meshes import read_positions
from ..data.result_keys import ERROR, PARTNER
from .readings import Reading, View
from .shown import heat_maps


def read_under(context: Context, view: View, x: float, y: float) -> Reading | None:
    """Return what the heat map under a place of a viewport, in pixels of its region, says there; None beside it."""
    origin = region_2d_to_origin_3d(view.region, view.data, (x, y))
    towards = region_2d_to_vector_3d(view.region, view.data, (x, y))
    depsgraph = context.evaluated_depsgraph_get()
    nearest: tuple[float, Object, Vector] | None = None
    for coloured in heat_maps(context):
        if coloured.mode != "OBJECT" or not coloured.visible_get(viewport=view.space):
            continue
        into = coloured.matrix_world.inverted_safe()
        start, ahead = into @ origin, into.to_3x3() @ towards
        if not ahead.length:
            continue
        found, place, _, _ = coloured.evaluated_get(depsgraph).ray_cast(start, ahead)
        if not found:
            continue
        away = (coloured.matrix_world @ place - origin).length
        if nearest is None or away < nearest[0]:
            nearest = away, coloured, place
    return None if nearest is None else read_at(nearest[1], nearest[2])


def read_at(coloured: Object, place: Vector) -> Reading:
    """Return what a heat map says at its vertex nearest to a place in its own coordinates."""
    mesh = coloured.data
    positions = read_positions(mesh)
    vertex = int(np.argmin(((positions - np.array(place, dtype=np.float32)) ** 2).sum(axis=1)))
    partner = None
    if PARTNER in mesh.attributes:
        partner = coloured.matrix_world @ Vector(mesh.attributes[PARTNER].data[vertex].vector)
    return Reading(
        coloured.name,
        vertex,
        coloured.matrix_world @ Vector(positions[vertex]),
        float(mesh.attributes[ERROR].data[vertex].value),
        partner,
    )

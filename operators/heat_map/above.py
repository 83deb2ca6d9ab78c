"""Selects where errors exceed a tolerance."""

from __future__ import annotations

import bpy
import numpy as np
from bpy.types import Object

from ..data.attributes import put, read
from ..data.result_keys import ERROR


def select_above(coloured: Object, tolerance: float) -> int:
    """Select the vertices whose errors exceed the tolerance, and nothing else, in Edit Mode; return their number."""
    if coloured.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    mesh = coloured.data
    above = np.abs(read(mesh, ERROR)) > tolerance
    # Edges and faces first: they would be selected again from vertices that were.
    for elements in (mesh.edges, mesh.polygons):
        put(elements, "select", np.zeros(len(elements)), np.bool_)
    put(mesh.vertices, "select", above, np.bool_)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.context.tool_settings.mesh_select_mode = (True, False, False)
    return int(above.sum())

"""Selects where errors exceed a tolerance."""

from __future__ import annotations

import bmesh
import bpy
import numpy as np
from bpy.types import Object

from ..data.attributes import read
from ..data.result_keys import ERROR


def select_above(coloured: Object, tolerance: float) -> int:
    """Select the vertices whose errors exceed the tolerance, and nothing else, in Edit Mode; return their number."""
    if coloured.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    mesh = coloured.data
    above = np.abs(read(mesh, ERROR)) > tolerance
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.context.tool_settings.mesh_select_mode = (True, False, False)
    # Blender 5.0 crashes now and then when selections are written into a mesh that has been in Edit Mode before.
    edited = bmesh.from_edit_mesh(mesh)
    for elements in (edited.verts, edited.edges, edited.faces):
        for element in elements:
            element.select = False
    for vertex, chosen in zip(edited.verts, above.tolist(), strict=True):
        vertex.select = chosen
    edited.select_flush_mode()
    bmesh.update_edit_mesh(mesh)
    return int(above.sum())

"""The operator that makes a heat map of the difference between any two meshes of like topology."""

from __future__ import annotations

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Object, Operator

from ..solver.errors import InputError
from .approximate import selected_meshes
from .heat_map.scale import colour_scale


class SPARSE_SURFACE_OT_compare(Operator):
    """Colour the active mesh by how far each of its vertices lies from the same vertex of the other selected mesh"""

    bl_idname = "sparse_surface.compare"
    bl_label = "Compare Two Meshes"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Context) -> bool:
        chosen = selected_meshes(context)
        if context.mode != "OBJECT":
            cls.poll_message_set("Switch to Object Mode first")
        elif len(chosen) != 2 or context.active_object not in chosen:
            cls.poll_message_set("Select two meshes with the same polygons; the active one gets the heat map")
        elif not context.active_object.data.is_editable:
            cls.poll_message_set("The active mesh is linked from another file and cannot be coloured")
        else:
            return True
        return False

    def execute(self, context: Context) -> set[str]:
        active = context.active_object
        other = next(o for o in selected_meshes(context) if o != active)
        try:
            largest = write_difference(context, active, other)
        except InputError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, rpt_("'{}' differs from '{}' by at most {:.3g}").format(active.name, other.name, largest))
        return {"FINISHED"}


def write_difference(context: Context, coloured: Object, other: Object) -> float:
    """Write the world distance of like vertices as errors of `coloured`; return the largest.

    Raises
    ------
    InputError
        When the meshes' polygons differ.
    """
    import numpy as np

    from .data import meshes as mesh_data

    if not mesh_data.same_topology(mesh_data.read_mesh(other.data), coloured.data):
        raise InputError(rpt_("'{}' and '{}' do not have the same polygons.").format(coloured.name, other.name))
    error = np.linalg.norm(mesh_data.world_positions(coloured) - mesh_data.world_positions(other), axis=1)
    scale = colour_scale(context.scene, error)
    mesh_data.write_error(coloured, error, scale)
    return float(error.max(initial=0.0))


CLASSES = (SPARSE_SURFACE_OT_compare,)

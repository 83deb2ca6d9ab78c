"""The operator that makes a heat map of the difference between two meshes of the same topology."""

from __future__ import annotations

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Operator

from ..solver.errors import InputError
from .data.objects import selected_meshes
from .run.poll import editable, needs, object_mode


def two_meshes(context: Context) -> str:
    """Two meshes are selected, one of them active."""
    chosen = selected_meshes(context)
    if len(chosen) == 2 and context.active_object in chosen:
        return ""
    return rpt_("Select two meshes with the same polygons; the active one gets the heat map")


class SPARSE_SURFACE_OT_compare(Operator):
    """Colour each vertex of the active mesh by its distance from the same vertex of the other selected mesh"""

    bl_idname = "sparse_surface.compare"
    bl_label = "Compare Two Meshes"
    bl_options = {"REGISTER", "UNDO"}

    poll = needs(object_mode, two_meshes, editable)

    def execute(self, context: Context) -> set[str]:
        from .heat_map.difference import write_difference  # NumPy-heavy: enabling the add-on loads this module

        active = context.active_object
        other = next(o for o in selected_meshes(context) if o != active)
        try:
            largest = write_difference(context, active, other)
        except InputError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, rpt_("'{}' differs from '{}' by at most {:.3g}").format(active.name, other.name, largest))
        return {"FINISHED"}

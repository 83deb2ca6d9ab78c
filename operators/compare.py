"""The operator that makes a heat map of the difference between two meshes of the same topology."""

from __future__ import annotations

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Object, Operator

from ..solver.errors import InputError
from .data.lengths import length_text
from .data.objects import selected_meshes
from .data.origins import source_of
from .run.poll import editable, needs, object_mode


def two_meshes(context: Context) -> str:
    """Two meshes are selected, one of them active, or one that was made from another."""
    if _pair(context) is not None:
        return ""
    return rpt_("Select a result, or two meshes with the same polygons; the active one gets the heat map")


def _pair(context: Context) -> tuple[Object, Object] | None:
    """Return the mesh that is to be coloured, and the one that it is compared with; of these, a result is coloured."""
    active, chosen = context.active_object, selected_meshes(context)
    if active not in chosen or len(chosen) > 2:
        return None
    other = source_of(active) if len(chosen) == 1 else next(o for o in chosen if o != active)
    if other is None or other.type != "MESH":
        return None
    return (other, active) if source_of(other) == active else (active, other)


class SPARSE_SURFACE_OT_compare(Operator):
    """Colour each vertex of the active mesh by its distance from the other selected mesh; a result, from its source"""

    bl_idname = "sparse_surface.compare"
    bl_label = "Compare Two Meshes"
    bl_options = {"REGISTER", "UNDO"}

    poll = needs(object_mode, two_meshes, editable)

    def execute(self, context: Context) -> set[str]:
        from .heat_map.difference import write_difference  # NumPy-heavy: enabling the add-on loads this module

        pair = _pair(context)
        assert pair is not None
        coloured, other = pair
        try:
            largest = write_difference(context, coloured, other)
        except InputError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        text = rpt_("'{}' differs from '{}' by at most {}")
        self.report({"INFO"}, text.format(coloured.name, other.name, length_text(context.scene, largest, digits=3)))
        return {"FINISHED"}

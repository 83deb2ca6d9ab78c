"""The operator that makes a result an object of its own, which can be approximated like any other."""

from __future__ import annotations

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Operator

from .data.origins import free, was_made
from .run.poll import needs, object_mode


def has_made(context: Context) -> str:
    """A selected object was made from another."""
    found = any(was_made(chosen) for chosen in context.selected_objects)
    return "" if found else rpt_("The selected objects were not made from others")


class SPARSE_SURFACE_OT_use_as_source(Operator):
    """Forget what the selected results were made from, so that Approximate works on them as they are"""

    bl_idname = "sparse_surface.use_as_source"
    bl_label = "Use as Source"
    bl_options = {"REGISTER", "UNDO"}

    poll = needs(object_mode, has_made)

    def execute(self, context: Context) -> set[str]:
        for chosen in context.selected_objects:
            free(chosen)
        return {"FINISHED"}

"""The operator that removes what Inspect Patch has laid out."""

from __future__ import annotations

import bpy
from bpy.types import Context, Operator

from .data.result_keys import INSPECTION
from .representation.clearing import clear_inspection
from .run.poll import needs, object_mode


def something_shown(context: Context) -> str:
    """The inspection shows something."""
    shown = context.scene.sparse_surface.inspection.holder or INSPECTION in bpy.data.collections
    return "" if shown else "There is nothing to clear"


class SPARSE_SURFACE_OT_clear_inspection(Operator):
    """Remove the domains and functions that Inspect Patch has laid out"""

    bl_idname = "sparse_surface.clear_inspection"
    bl_label = "Clear Inspection"
    bl_options = {"REGISTER", "UNDO"}

    poll = needs(object_mode, something_shown)

    def execute(self, context: Context) -> set[str]:
        clear_inspection(context)
        return {"FINISHED"}

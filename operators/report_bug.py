"""The operator that helps to report a bug: it copies the versions, and opens the page."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Event, Operator

from .run.about import bug_page, system_text


class SPARSE_SURFACE_OT_report_bug(Operator):
    """Copy the versions of Blender, the add-on and its packages to the clipboard, and open the page for bugs"""

    bl_idname = "sparse_surface.report_bug"
    bl_label = "Report a Bug"
    bl_options = {"INTERNAL"}

    def invoke(self, context: Context, event: Event) -> set[str]:
        if bug_page():
            bpy.ops.wm.url_open(url=bug_page())
        return self.execute(context)

    def execute(self, context: Context) -> set[str]:
        context.window_manager.clipboard = system_text()
        self.report({"INFO"}, rpt_("Versions copied: paste them into your report"))
        return {"FINISHED"}

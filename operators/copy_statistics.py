"""The operator that copies a result's figures to the clipboard."""

import json
from functools import partial

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.props import EnumProperty
from bpy.types import Context, Operator

from .data.lengths import length_text
from .data.report_text import table
from .data.result_keys import read_report
from .run.poll import needs, result


class SPARSE_SURFACE_OT_copy_statistics(Operator):
    """Copy the statistics of the active result to the clipboard"""

    bl_idname = "sparse_surface.copy_statistics"
    bl_label = "Copy Statistics"
    bl_options = {"INTERNAL"}

    form: EnumProperty(
        name="Form",
        description="How the statistics are written",
        items=[
            ("TEXT", "Text", "The figures of the panel, a line for each"),
            ("JSON", "JSON", "The whole report, for scripts"),
        ],
        default="TEXT",
    )

    poll = needs(result)

    def execute(self, context: Context) -> set[str]:
        report = read_report(context.active_object) or {}
        if self.form == "TEXT":
            length = partial(length_text, context.scene, digits=6)
            text = table(context.active_object.name, report, length)
        else:
            text = json.dumps(report, indent=2)
        context.window_manager.clipboard = text
        self.report({"INFO"}, rpt_("Statistics copied"))
        return {"FINISHED"}

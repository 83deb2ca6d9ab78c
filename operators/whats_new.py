"""The operator that shows what a new version brings."""

from __future__ import annotations

import textwrap

from bpy.types import Context, Event, Operator

from ..solver.version import VERSION
from .run.about import news, note_version

WIDTH = 420
CHARACTERS = 66
"""What fits on a line of that width."""


class SPARSE_SURFACE_OT_whats_new(Operator):
    """Show what is new in this version of the add-on"""

    bl_idname = "sparse_surface.whats_new"
    bl_label = "What's New"
    bl_options = {"INTERNAL"}

    def invoke(self, context: Context, event: Event) -> set[str]:
        note_version(context)
        return set(context.window_manager.invoke_popup(self, width=WIDTH))

    def draw(self, context: Context) -> None:
        self.layout.label(text=f"Sparse Surface {VERSION}", icon="INFO", translate=False)
        for entry in news():
            column = self.layout.column(align=True)
            for number, line in enumerate(textwrap.wrap(entry, CHARACTERS)):
                column.label(text=line, icon="DOT" if number == 0 else "BLANK1", translate=False)

    def execute(self, context: Context) -> set[str]:
        note_version(context)
        return {"FINISHED"}

"""What the panels of the sidebar have in common: place, two-column style, sentences in lines."""

from __future__ import annotations

import textwrap

from bpy.types import Context, UILayout


class SidebarPanel:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Sparse Surface"

    def column(self, context: Context) -> UILayout:
        """Return a column in Blender's two-column style."""
        layout = self.layout  # type: ignore[attr-defined]
        layout.use_property_split = True
        layout.use_property_decorate = False
        return layout.column()


class SubPanel(SidebarPanel):
    bl_parent_id = "SPARSE_SURFACE_PT_main"
    bl_options = {"DEFAULT_CLOSED"}


def draw_lines(layout: UILayout, text: str, icon: str) -> None:
    """Show a sentence in lines that fit a narrow sidebar."""
    column = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, 34)):
        column.label(text=line, icon=icon if number == 0 or icon == "NONE" else "BLANK1", translate=False)

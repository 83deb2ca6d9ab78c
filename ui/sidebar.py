"""What the panels of the sidebar have in common: place, two-column style, sentences in lines."""

from __future__ import annotations

import textwrap

from bpy.types import Context, UILayout

from ..operators.run.status import settle_sidebars


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


_drawn: list[tuple[object, ...]] = []
"""What decided, when the sidebar was last drawn, which rows there are."""


def settle_if_changed(context: Context, job: str) -> None:
    """Have the sidebar drawn again if its panels may have other heights than before: Blender moves them only then."""
    active = context.active_object
    decides = (context.mode, job, active.name if active is not None else "", len(context.selected_objects))
    if _drawn != [decides]:
        _drawn[:] = [decides]
        settle_sidebars()


def draw_lines(layout: UILayout, text: str, icon: str) -> None:
    """Show a sentence in lines that fit a narrow sidebar."""
    column = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, 34)):
        column.label(text=line, icon=icon if number == 0 or icon == "NONE" else "BLANK1", translate=False)


def draw_weights(layout: UILayout, context: Context) -> None:
    """Let the user choose among the active object's vertex groups."""
    settings, active = context.scene.sparse_surface, context.active_object
    if active is not None and active.type == "MESH":
        layout.prop_search(settings, "vertex_group", active, "vertex_groups")
    else:
        layout.prop(settings, "vertex_group")

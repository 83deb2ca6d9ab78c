"""The panels for one patch of a result and for comparing methods."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_
from bpy.types import Context, Panel, UILayout, UIList

from ..operators.data.result_keys import has_representation
from .result_panel import UnderResult
from .sidebar import SubPanel


class SPARSE_SURFACE_UL_terms(UIList):
    """The functions that a patch uses: name, and a coefficient for each of x, y and z."""

    def draw_item(
        self,
        context: Context,
        layout: UILayout,
        data: Any,
        item: Any,
        icon: int,
        active_data: Any,
        active_property: str,
        index: int = 0,
        flt_flag: int = 0,
    ) -> None:
        row = layout.split(factor=0.34)
        row.label(text=item.name, translate=False)
        amounts = row.row()
        for amount in item.amounts:
            amounts.label(text=f"{amount:.2g}" if amount else "·", translate=False)


class SPARSE_SURFACE_PT_inspect(UnderResult, Panel):
    bl_label = "Inspect Patch"

    @classmethod
    def poll(cls, context: Context) -> bool:
        return has_representation(context.active_object) or bool(context.scene.sparse_surface.inspection.holder)

    def draw(self, context: Context) -> None:
        column = self.column(context)
        inspection = context.scene.sparse_surface.inspection
        row = column.row(align=True)
        row.operator("sparse_surface.inspect_patch", text="", icon="TRIA_LEFT").which = "PREVIOUS"
        row.prop(inspection, "patch", text="")
        row.operator("sparse_surface.inspect_patch", text="", icon="TRIA_RIGHT").which = "NEXT"
        row = column.row(align=True)
        row.operator("sparse_surface.inspect_patch", text="Show", icon="VIEWZOOM").which = "CHOSEN"
        row.operator("sparse_surface.inspect_patch", text="At Selection", icon="RESTRICT_SELECT_OFF").which = "SELECTED"
        row.operator("sparse_surface.clear_inspection", text="", icon="TRASH")
        if inspection.holder:
            draw_inspection(self.layout, inspection)


class SPARSE_SURFACE_PT_compare(SubPanel, Panel):
    bl_label = "Compare Methods"

    @classmethod
    def poll(cls, context: Context) -> bool:
        return bool(context.scene.sparse_surface.job == "MEASURE")

    def draw(self, context: Context) -> None:
        comparison = context.scene.sparse_surface.comparison
        column = self.column(context)
        column.prop(comparison, "first")
        column.prop(comparison, "second")
        column.prop(comparison, "beside")
        column.operator("sparse_surface.compare_methods", icon="ARROW_LEFTRIGHT")


def draw_inspection(layout: UILayout, inspection: Any) -> None:
    """Show a patch's functions and how its energy fell."""
    layout.label(text=inspection.holder, icon="OUTLINER_OB_MESH", translate=False)
    text = iface_("Patch {} of {}: {} vertices, {} functions")
    layout.label(
        text=text.format(inspection.patch, inspection.patches, inspection.vertices, len(inspection.terms)),
        translate=False,
    )
    layout.template_list("SPARSE_SURFACE_UL_terms", "", inspection, "terms", inspection, "term", rows=6)
    if inspection.energy:
        layout.label(text="Energy after each iteration")
        column = layout.column(align=True)
        for number, entry in enumerate(inspection.energy):
            column.progress(factor=min(max(entry.value, 0.0), 1.0), text=f"{number + 1}: {entry.value:.3g}")


CLASSES = (
    SPARSE_SURFACE_UL_terms,
    SPARSE_SURFACE_PT_inspect,
    SPARSE_SURFACE_PT_compare,
)

register, unregister = bpy.utils.register_classes_factory(CLASSES)

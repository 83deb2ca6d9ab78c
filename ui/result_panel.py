"""The panel of a result, seen only while one is active: how close it is, how it looks, what can be made of it."""

from __future__ import annotations

from functools import partial
from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_
from bpy.types import Context, Object, Panel, Scene, UILayout

from ..operators.data.lengths import length_text
from ..operators.data.noise_key import can_blend, has_removed_noise
from ..operators.data.report_text import rows, verdict, warnings
from ..operators.data.result_keys import (
    DRAFT,
    REPORT,
    REPRESENTATION,
    has_heat_map,
    has_patches,
    has_representation,
    read_report,
    shows_patches,
)
from .panels import draw_display, draw_heat_map_button, draw_looking
from .sidebar import SidebarPanel, draw_lines


class SPARSE_SURFACE_PT_result(SidebarPanel, Panel):
    bl_label = "Result"

    @classmethod
    def poll(cls, context: Context) -> bool:
        return is_result(context.active_object)

    def draw(self, context: Context) -> None:
        column = self.column(context)
        report = read_report(context.active_object)
        if report is not None:
            draw_quality(column, report, context.scene)
        if has_removed_noise(context.active_object):
            row = column.row()
            row.enabled = can_blend(context.active_object)
            row.prop(context.scene.sparse_surface.inspection, "strength", slider=True)
        if has_heat_map(context.active_object):
            draw_heat_map_button(column, context)
        if has_patches(context.active_object):
            shown = shows_patches(context.active_object)
            text = "Show Errors" if shown else "Show Patches"
            column.operator("sparse_surface.show_patches", text=text, icon="COLOR", depress=shown)
        if has_representation(context.active_object) or (report is not None and "parts" in report["input"]):
            row = column.row(align=True)
            inspection = context.scene.sparse_surface.inspection
            row.operator("sparse_surface.resample", icon="MOD_SUBSURF").splits = inspection.splits
            amount = row.row(align=True)
            amount.use_property_split = False
            amount.prop(inspection, "splits", text="")
        if report is not None:
            column.operator("sparse_surface.run_again", icon="FILE_REFRESH")
        column.operator("sparse_surface.show_source", icon="HIDE_OFF")
        if report is not None and "points" in report["input"]:
            column.operator("sparse_surface.show_point_errors", icon="POINTCLOUD_DATA")
        column.operator("sparse_surface.apply_to_source", icon="CHECKMARK")


class UnderResult(SidebarPanel):
    bl_parent_id = "SPARSE_SURFACE_PT_result"
    bl_options = {"DEFAULT_CLOSED"}


class SPARSE_SURFACE_PT_statistics(UnderResult, Panel):
    bl_label = "Statistics"

    def draw(self, context: Context) -> None:
        report = read_report(context.active_object)
        if report is None:
            self.layout.label(text="This object has errors but no report")
            return
        draw_statistics(self.layout, report, context.scene)
        row = self.layout.row(align=True)
        row.operator("sparse_surface.copy_statistics", text="Copy as Text", icon="COPYDOWN").form = "TEXT"
        row.operator("sparse_surface.copy_statistics", text="Copy as JSON").form = "JSON"


class SPARSE_SURFACE_PT_display(UnderResult, Panel):
    bl_label = "Colours of the Heat Map"

    @classmethod
    def poll(cls, context: Context) -> bool:
        return bool(has_heat_map(context.active_object) and context.scene.sparse_surface.job != "MEASURE")

    def draw(self, context: Context) -> None:
        column = self.column(context)
        draw_display(column, context.scene.sparse_surface)
        draw_looking(column)
        column.operator("sparse_surface.use_heat_map_material", icon="MATERIAL")


class SPARSE_SURFACE_PT_representation(UnderResult, Panel):
    bl_label = "Representation"

    @classmethod
    def poll(cls, context: Context) -> bool:
        return has_representation(context.active_object)

    def draw(self, context: Context) -> None:
        column = self.column(context)
        report = read_report(context.active_object)
        if report is not None:
            size = len(context.active_object[REPRESENTATION]) / 1e6
            said = iface_("{} patches, {:.2g} MB").format(report["patches"], size)
            if DRAFT in context.active_object:  # it will be smaller soon
                said = iface_("{} patches").format(report["patches"])
            column.label(text=said, translate=False)
        column.operator("sparse_surface.separate_patches", icon="OUTLINER_COLLECTION")
        column.operator("sparse_surface.domains_to_uv", icon="UV")


ICONS = {"Coarse": "INFO", "Far off": "ERROR"}
"""Beside the words for surfaces that are not close."""


def is_result(candidate: Object | None) -> bool:
    """Whether an object carries a report or a heat map."""
    return candidate is not None and (REPORT in candidate or has_heat_map(candidate))


def draw_quality(layout: UILayout, report: dict[str, Any], scene: Scene) -> None:
    """Show in words and figures how close a surface is, and whether the tolerance is kept."""
    length = partial(length_text, scene)
    column = layout.column(align=True)
    measured = report["denoise"]["fit"] if "denoise" in report else report  # noise is not an error of the fit
    if "denoise" in report:
        column.label(text=iface_("Noise removed: {}").format(length(report["denoise"]["noise_level"])), translate=False)
    if report["patches"]:
        word = verdict(report)
        column.label(text=word, icon=ICONS.get(word, "CHECKMARK"))
        text = iface_("Typical error {}").format(length(measured["surface_error"]["rms"]))
        column.label(text=text, icon="BLANK1", translate=False)
        text = iface_("Largest at a vertex {}").format(length(report["vertex_error"]["max"]))
        column.label(text=text, icon="BLANK1", translate=False)
    if report.get("ended_early"):
        column.label(text="Ended early", icon="INFO")
        if "bound" not in report["surface_error"] and "points" not in report["input"]:
            column.label(text="The largest error was only sampled", icon="BLANK1")
    for sentence in warnings(report, length):
        draw_lines(column, sentence[:1].upper() + sentence[1:], "ERROR")
    tolerance = report["settings"]["tolerance"]
    if tolerance:
        kept = measured["surface_error"]["max"] <= tolerance
        text = iface_("Within the tolerance") if kept else iface_("Exceeds the tolerance")
        if kept and report.get("ended_early") and "bound" not in measured["surface_error"]:
            kept, text = False, iface_("Not shown to keep the tolerance")
        column.label(text=f"{text} ({length(tolerance)})", icon="CHECKMARK" if kept else "ERROR", translate=False)


def draw_statistics(layout: UILayout, report: dict[str, Any], scene: Scene) -> None:
    """Show a report's figures as a table."""
    column = layout.column(align=True)
    for label, value in rows(report, partial(length_text, scene)):
        split = column.split(factor=0.6)
        split.label(text=label)
        split.label(text=f"{value:.4g}" if isinstance(value, float) else str(value), translate=False)


CLASSES = (
    SPARSE_SURFACE_PT_result,
    SPARSE_SURFACE_PT_statistics,
    SPARSE_SURFACE_PT_display,
    SPARSE_SURFACE_PT_representation,
)

register, unregister = bpy.utils.register_classes_factory(CLASSES)

"""The sidebar: 3D View > Sidebar > Sparse Surface."""

from __future__ import annotations

import textwrap
from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_
from bpy.types import Context, Panel, UILayout

from ..operators.data.objects import current_name, selected_meshes
from ..operators.data.report_text import rows
from ..operators.data.result_keys import read_report
from ..operators.run import preloading
from ..operators.run.control import Run
from ..operators.run.estimate import LARGE_MESH, estimate, vertex_count
from ..operators.run.poll import MESHES_TO_SOLVE, packages, reason_against
from ..operators.run.session import session
from ..operators.run.status import duration_text, remaining_text
from ..operators.run.way_on import draw_way_on
from ..operators.show_heat_map import shows_heat_map
from ..solver.patch_methods import METHODS
from .presets import SPARSE_SURFACE_PT_presets
from .properties import CLOUD_NAMES, SOLVER_NAMES

MAIN = ("method", "ring", "degree", "sparsity", "tolerance")
DOMAIN = ("initial_domain", "domains", "iterations", "beta1", "beta2", "adaptive", "mark_creases", "pin_boundary")
DICTIONARY = ("basis", "pursuit", "automatic_sparsity", "observations")
OF_ONE_METHOD = tuple(name for method in METHODS.values() for name in method.own_settings)
SWEEPS = ("sweeps", "blending")
NOISE = ("denoise", "denoise_strength", "noise_level")
OUTPUT = ("keep_iterations", "solver", "workers")

MORE = tuple(
    name for name in SOLVER_NAMES if name not in {*MAIN, *DOMAIN, *DICTIONARY, *OF_ONE_METHOD, *SWEEPS, *NOISE, *OUTPUT}
)
"""Settings that no other group names."""


class SidebarPanel:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Sparse Surface"

    def column(self, context: Context) -> UILayout:
        """Return a column in Blender's two-column style."""
        layout = self.layout  # type: ignore[attr-defined]
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.enabled = session.current is None
        return layout.column()


class SubPanel(SidebarPanel):
    bl_parent_id = "SPARSE_SURFACE_PT_main"
    bl_options = {"DEFAULT_CLOSED"}


class SPARSE_SURFACE_PT_main(SidebarPanel, Panel):
    bl_label = "Sparse Surface"

    def draw_header_preset(self, context: Context) -> None:
        SPARSE_SURFACE_PT_presets.draw_panel_header(self.layout)

    def draw(self, context: Context) -> None:
        if session.current is not None:
            draw_progress(self.layout, session.current)
            return
        preloading.preload()
        missing = packages(context)
        if missing:
            draw_lines(self.layout, missing, "ERROR")
        elif session.notice:
            draw_lines(self.layout, session.notice, "INFO")
        column = self.column(context)
        for name in MAIN:
            column.prop(context.scene.sparse_surface, name)
        draw_estimate(self.layout.column(align=True), context)
        button = self.layout.row()
        button.scale_y = 1.5
        chosen = selected_meshes(context)
        text = iface_("Approximate") if len(chosen) < 2 else iface_("Approximate {} Meshes").format(len(chosen))
        button.operator("sparse_surface.approximate", text=text, icon="MOD_SMOOTH", translate=False)
        draw_way_on(self.layout, context)


class SPARSE_SURFACE_PT_domain(SubPanel, Panel):
    bl_label = "Domain and Regularisation"

    def draw(self, context: Context) -> None:
        settings = context.scene.sparse_surface
        column = self.column(context)
        for name in DOMAIN:
            column.prop(settings, name)
        column.separator()
        for name in (*DICTIONARY, *MORE):
            column.prop(settings, name)
        column.separator()
        read = METHODS[settings.method].own_settings
        for name in OF_ONE_METHOD:
            row = column.row()
            row.active = name in read
            row.prop(settings, name)


class SPARSE_SURFACE_PT_sweeps(SubPanel, Panel):
    bl_label = "Sweeps and Blending"

    def draw(self, context: Context) -> None:
        column = self.column(context)
        for name in SWEEPS:
            column.prop(context.scene.sparse_surface, name)


class SPARSE_SURFACE_PT_noise(SubPanel, Panel):
    bl_label = "Noise"

    def draw(self, context: Context) -> None:
        settings = context.scene.sparse_surface
        column = self.column(context)
        first, *others = NOISE
        column.prop(settings, first)
        how = column.column()
        how.active = settings.denoise != "off"
        for name in others:
            how.prop(settings, name)


class SPARSE_SURFACE_PT_points(SubPanel, Panel):
    bl_label = "Points to Surface"

    def draw(self, context: Context) -> None:
        settings = context.scene.sparse_surface.reconstruction
        column = self.column(context)
        column.prop(settings, "base")
        if settings.base is None:
            column.prop(settings, "base_vertices")
            column.prop(settings, "keep_base")
        column.separator()
        for name in CLOUD_NAMES:
            column.prop(settings, name)
        column.separator()
        column.prop(settings, "splits")
        column.prop(settings, "point_errors")
        button = self.layout.row()
        button.scale_y = 1.5
        button.enabled = session.current is None
        button.operator("sparse_surface.reconstruct", icon="POINTCLOUD_DATA")


class SPARSE_SURFACE_PT_output(SubPanel, Panel):
    bl_label = "Input and Output"

    def draw(self, context: Context) -> None:
        settings = context.scene.sparse_surface
        column = self.column(context)
        column.prop(settings, "use_modifiers")
        active = context.active_object
        if active is not None and active.type == "MESH":
            column.prop_search(settings, "vertex_group", active, "vertex_groups")
        else:
            column.prop(settings, "vertex_group")
        column.separator()
        column.prop(settings, "replace_result")
        column.prop(settings, "source_shown")
        column.prop(settings, "show_preview")
        kind = column.row()
        kind.active = settings.show_preview
        kind.prop(settings, "preview_kind")
        for name in OUTPUT:
            column.prop(settings, name)


class SPARSE_SURFACE_PT_display(SubPanel, Panel):
    bl_label = "Display"

    def draw(self, context: Context) -> None:
        display = context.scene.sparse_surface.display
        column = self.column(context)
        shown = shows_heat_map(context.space_data)
        column.operator(
            "sparse_surface.show_heat_map",
            text="Hide Heat Map" if shown else "Show Heat Map",
            icon="HIDE_OFF" if shown else "COLOR",
            depress=shown,
        )
        column.prop(display, "isolate")
        column.separator()
        column.prop(display, "inside_outside")
        if display.inside_outside:
            settings = context.scene.sparse_surface
            column.prop(settings if settings.tolerance else display, "tolerance")
        else:
            column.prop(display, "range_mode")
            if display.range_mode == "FIXED":
                column.prop(display, "range_maximum")
            elif display.range_mode == "PERCENTILE":
                column.prop(display, "range_percentile")
        column.separator()
        column.operator("sparse_surface.compare", icon="MOD_MESHDEFORM")


class SPARSE_SURFACE_PT_statistics(SubPanel, Panel):
    bl_label = "Statistics"

    def draw(self, context: Context) -> None:
        report = read_report(context.active_object)
        if report is None:
            self.layout.label(text="Select a result to see its figures")
            return
        draw_statistics(self.layout, report)
        row = self.layout.row(align=True)
        row.operator("sparse_surface.copy_statistics", text="Copy as Text", icon="COPYDOWN").form = "TEXT"
        row.operator("sparse_surface.copy_statistics", text="Copy as JSON").form = "JSON"
        self.layout.operator("sparse_surface.separate_patches", icon="OUTLINER_COLLECTION")


def draw_progress(layout: UILayout, run: Run) -> None:
    """Show the progress of a run, and the buttons that end it."""
    column = layout.column()
    if run.waiting:
        draw_lines(column, iface_("The surface is ready: return to Object Mode to receive it"), "INFO")
    elif run.progress is None:
        column.label(text="Starting the solver")
    else:
        if run.current_source is not None:
            column.label(text=current_name(run.current_source), icon="OUTLINER_OB_MESH", translate=False)
        column.progress(factor=run.progress.fraction, text=f"{run.progress.fraction:.0%}")
        column.label(text=run.progress.stage)
        if run.progress.detail:
            column.label(text=run.progress.detail, translate=False)
        column.label(text=remaining_text(run), translate=False)
    row = layout.row(align=True)
    row.operator("sparse_surface.finish", icon="CHECKMARK")
    row.operator("sparse_surface.cancel", icon="CANCEL")


def draw_estimate(layout: UILayout, context: Context) -> None:
    """Show the estimated patch count and run time, and warn of large meshes."""
    count = sum(vertex_count(chosen, context) for chosen in selected_meshes(context))
    if not count or reason_against(context, *MESHES_TO_SOLVE):
        return
    expected = estimate(count, context.scene.sparse_surface.to_settings())
    text = iface_("About {} patches, {}").format(expected.patches, duration_text(expected.seconds))
    if not expected.patches:
        text = iface_("About {}").format(duration_text(expected.seconds))
    layout.label(text=text, icon="TIME", translate=False)
    if count > LARGE_MESH:
        warning = iface_("Large mesh: about {:.1f} GB of memory").format(expected.gigabytes)
        layout.label(text=warning, icon="ERROR", translate=False)


def draw_statistics(layout: UILayout, report: dict[str, Any]) -> None:
    """Show a report's figures as a table, and whether the tolerance is kept."""
    column = layout.column(align=True)
    tolerance = report["settings"]["tolerance"]
    if tolerance:
        measured = report["denoise"]["fit"] if "denoise" in report else report  # noise is not an error of the fit
        kept = measured["surface_error"]["max"] <= tolerance
        text = iface_("Within the tolerance") if kept else iface_("Exceeds the tolerance")
        column.label(text=f"{text} ({tolerance:.4g})", icon="CHECKMARK" if kept else "ERROR", translate=False)
    for label, value in rows(report):
        split = column.split(factor=0.6)
        split.label(text=label)
        split.label(text=f"{value:.4g}" if isinstance(value, float) else str(value), translate=False)


def draw_lines(layout: UILayout, text: str, icon: str) -> None:
    """Show a sentence in lines that fit a narrow sidebar."""
    column = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, 34)):
        column.label(text=line, icon=icon if number == 0 else "BLANK1", translate=False)


CLASSES = (
    SPARSE_SURFACE_PT_main,
    SPARSE_SURFACE_PT_domain,
    SPARSE_SURFACE_PT_sweeps,
    SPARSE_SURFACE_PT_noise,
    SPARSE_SURFACE_PT_points,
    SPARSE_SURFACE_PT_output,
    SPARSE_SURFACE_PT_display,
    SPARSE_SURFACE_PT_statistics,
)

register, unregister = bpy.utils.register_classes_factory(CLASSES)

"""The sidebar, 3D View > Sidebar > Sparse Surface: four jobs, each with its few settings and its button."""

from __future__ import annotations

from collections.abc import Callable

import bpy
from bpy.app.translations import pgettext_iface as iface_
from bpy.types import Context, Panel, PropertyGroup, UILayout

from ..operators.data.objects import current_name, selected_meshes, selected_points
from ..operators.data.presets import matching_preset, preset_title
from ..operators.heat_map.readings import readings
from ..operators.heat_map.shown import shows_heat_map
from ..operators.run import preloading
from ..operators.run.about import was_updated
from ..operators.run.control import Run
from ..operators.run.estimate import (
    LARGE_MESH,
    Estimate,
    coarse_meshes,
    estimate_cloud,
    estimate_meshes,
    point_count,
    vertex_count,
)
from ..operators.run.poll import MESHES_TO_SOLVE, packages, reason_against
from ..operators.run.session import session
from ..operators.run.status import duration_text, in_words, remaining_text
from ..operators.run.way_on import draw_way_on
from ..solver.version import VERSION
from .jobs import ITEMS
from .optional import draw_optional
from .sidebar import SidebarPanel, draw_lines, draw_weights, settle_if_changed


class SPARSE_SURFACE_PT_main(SidebarPanel, Panel):
    bl_label = "Sparse Surface"

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
        elif was_updated(context):
            text = iface_("New in {}").format(VERSION)
            self.layout.operator("sparse_surface.whats_new", text=text, icon="INFO", translate=False)
        settings = context.scene.sparse_surface
        settle_if_changed(context, settings.job)
        jobs = self.layout.grid_flow(row_major=True, columns=2, even_columns=True, align=True)
        jobs.scale_y = 1.2
        for job, *_ in ITEMS:
            jobs.prop_enum(settings, "job", job)
        self.layout.separator(factor=0.5)
        DRAW_JOB[settings.job](self.column(context), context, settings)


def draw_approximate(layout: UILayout, context: Context, settings: PropertyGroup) -> None:
    """Show what matters when a mesh is approximated."""
    draw_preset(layout, settings)
    draw_optional(layout, settings, "tolerance")
    layout.prop(settings, "use_modifiers")
    draw_solve(layout, context, "Approximate", "Approximate {} Meshes", "MOD_SMOOTH")


def draw_denoise(layout: UILayout, context: Context, settings: PropertyGroup) -> None:
    """Show what matters when noise is removed."""
    how = layout.column(align=True)
    how.use_property_split = False
    for choice in ("only", "first"):
        how.prop_enum(settings, "denoise", choice)
    layout.separator(factor=0.5)
    layout.prop(settings, "denoise_strength")
    draw_optional(layout, settings, "noise_level")
    draw_weights(layout, context)
    layout.prop(settings, "creases")
    draw_solve(layout, context, "Denoise", "Denoise {} Meshes", "BRUSH_DATA")


def draw_reconstruct(layout: UILayout, context: Context, settings: PropertyGroup) -> None:
    """Show what matters when points become a surface."""
    cloud = settings.reconstruction
    layout.prop(cloud, "base")
    if cloud.base is None:
        draw_optional(layout, cloud, "base_vertices")
    draw_optional(layout, cloud, "splits")
    layout.prop(cloud, "robust")
    draw_optional(layout, cloud, "noise")
    draw_optional(layout, settings, "tolerance")
    layout.prop(cloud, "point_errors")
    count = point_count(selected_points(context), context)
    if count:
        base = cloud.base_vertices if cloud.base is None else len(cloud.base.data.vertices)
        draw_expected(layout.column(align=True), estimate_cloud(count, base), count)
    big_button(layout).operator("sparse_surface.reconstruct", icon="POINTCLOUD_DATA")


def draw_measure(layout: UILayout, context: Context, settings: PropertyGroup) -> None:
    """Show what measures distances, and how they are looked at."""
    how = settings.measurement
    layout.prop(how, "reference")
    layout.prop(how, "signed")
    layout.prop(how, "align")
    if how.align != "none":
        layout.prop(how, "move")
    layout.prop(how, "samples")
    big_button(layout).operator("sparse_surface.distance", icon="DRIVER_DISTANCE")
    layout.operator("sparse_surface.compare", icon="MOD_MESHDEFORM")
    layout.separator()
    draw_heat_map_button(layout, context)
    draw_display(layout, settings)
    draw_looking(layout)


def draw_looking(layout: UILayout) -> None:
    """Show what reads and selects values of a heat map."""
    reading = readings.going_on
    layout.operator(
        "sparse_surface.read_values",
        text="Stop Reading" if reading else "Read Values",
        icon="EYEDROPPER",
        depress=reading,
    )
    layout.operator("sparse_surface.select_above", icon="RESTRICT_SELECT_OFF")


DRAW_JOB: dict[str, Callable[[UILayout, Context, PropertyGroup], None]] = {
    "APPROXIMATE": draw_approximate,
    "DENOISE": draw_denoise,
    "RECONSTRUCT": draw_reconstruct,
    "MEASURE": draw_measure,
}


def draw_preset(layout: UILayout, settings: PropertyGroup) -> None:
    """Show the name of the preset that is set, with the list of all."""
    name = matching_preset(settings.to_settings())
    row = layout.split(factor=0.4, align=True)
    label = row.row()
    label.alignment = "RIGHT"
    label.label(text="Preset")
    row.popover("SPARSE_SURFACE_PT_presets", text=iface_(preset_title(name) if name else "Custom"), translate=False)


def draw_solve(layout: UILayout, context: Context, one: str, several: str, icon: str) -> None:
    """Show what to expect, and the button."""
    draw_estimate(layout.column(align=True), context)
    chosen = selected_meshes(context)
    text = iface_(one) if len(chosen) < 2 else iface_(several).format(len(chosen))
    big_button(layout).operator("sparse_surface.approximate", text=text, icon=icon, translate=False)
    draw_way_on(layout, context)


def big_button(layout: UILayout) -> UILayout:
    """Return a row for the button of a job."""
    button = layout.row()
    button.scale_y = 1.5
    return button


def draw_heat_map_button(layout: UILayout, context: Context) -> None:
    """Show the button that switches the heat map on and off."""
    shown = shows_heat_map(context.space_data)
    layout.operator(
        "sparse_surface.show_heat_map",
        text="Hide Heat Map" if shown else "Show Heat Map",
        icon="HIDE_OFF" if shown else "COLOR",
        depress=shown,
    )


def draw_display(layout: UILayout, settings: PropertyGroup) -> None:
    """Show how errors are coloured."""
    display = settings.display
    layout.prop(display, "isolate")
    layout.prop(display, "inside_outside")
    if display.inside_outside:
        layout.prop(settings if settings.tolerance else display, "tolerance")
        return
    layout.prop(display, "range_mode")
    if display.range_mode == "FIXED":
        layout.prop(display, "range_maximum")
    elif display.range_mode == "PERCENTILE":
        layout.prop(display, "range_percentile")


def draw_progress(layout: UILayout, run: Run) -> None:
    """Show the progress of a run, and the buttons that end it.

    Always in the same rows: Blender moves what lies below only some redraws later, and draws over it meanwhile.
    """
    column = layout.column()
    source, progress = run.current_source, run.progress
    column.label(text=current_name(source) if source is not None else "", icon="OUTLINER_OB_MESH", translate=False)
    fraction = progress.fraction if progress is not None else 0.0
    column.progress(factor=fraction, text=f"{fraction:.0%}")
    column.label(text=progress.stage if progress is not None else "Starting the solver")
    column.label(text=in_words(progress.detail) if progress is not None else "", translate=False)
    column.label(text=remaining_text(run), translate=False)
    row = layout.row(align=True)
    row.operator("sparse_surface.finish", icon="CHECKMARK")
    row.operator("sparse_surface.cancel", icon="CANCEL")
    if run.waiting:
        draw_lines(layout, iface_("The surface is ready: return to Object Mode to receive it"), "INFO")


def draw_estimate(layout: UILayout, context: Context) -> None:
    """Show the estimated patch count and run time, and warn of meshes that are too coarse or large."""
    chosen = selected_meshes(context)
    count = sum(vertex_count(each, context) for each in chosen)
    if not count or reason_against(context, *MESHES_TO_SOLVE):
        return
    for coarse in coarse_meshes(chosen, context):
        text = iface_("{} vertices: too coarse to approximate; subdivide first")
        draw_lines(layout, text.format(vertex_count(coarse, context)), "ERROR")
    if coarse_meshes(chosen, context):
        layout.operator("sparse_surface.subdivide", icon="MOD_SUBSURF")
    draw_expected(layout, estimate_meshes(chosen, context), count)


def draw_expected(layout: UILayout, expected: Estimate, count: int) -> None:
    """Show how many patches and how much time to expect, and a warning where there are many vertices or points."""
    text = iface_("At least {} patches, {}") if expected.at_least else iface_("About {} patches, {}")
    text = text.format(expected.patches, duration_text(expected.seconds))
    if not expected.patches:
        text = iface_("About {}").format(duration_text(expected.seconds))
    layout.label(text=text, icon="TIME", translate=False)
    if count > LARGE_MESH:
        warning = iface_("Large mesh: about {:.1f} GB of memory").format(expected.gigabytes)
        layout.label(text=warning, icon="ERROR", translate=False)


CLASSES = (SPARSE_SURFACE_PT_main,)

register, unregister = bpy.utils.register_classes_factory(CLASSES)

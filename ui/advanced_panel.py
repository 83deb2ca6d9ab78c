"""The panel Advanced, closed at first: every setting that no job shows by itself."""

from __future__ import annotations

import bpy
from bpy.types import Context, Panel

from ..solver.patch_methods import METHODS
from .optional import draw_optional
from .properties import CLOUD_NAMES, OPTIONAL_CLOUD, SOLVER_NAMES
from .sidebar import SubPanel, draw_weights

OF_JOBS = ("tolerance", "denoise", "denoise_strength", "noise_level")
"""Settings that the jobs show."""

PATCHES = ("ring", "degree", "sparsity", "automatic_sparsity", "sweeps", "blending")
DOMAIN = ("initial_domain", "domains", "iterations", "beta1", "beta2", "adaptive", "mark_creases", "pin_boundary")
PAPER = ("method", "basis", "pursuit", "observations")
OF_ONE_METHOD = tuple(name for method in METHODS.values() for name in method.own_settings)
OUTPUT = ("keep_iterations", "solver", "merge_vertices", "merge_distance", "workers")

_PLACED = {*OF_JOBS, *PATCHES, *DOMAIN, *PAPER, *OF_ONE_METHOD, *OUTPUT}
MORE = tuple(name for name in SOLVER_NAMES if name not in _PLACED)
"""Settings that no other group names."""

POINTS = tuple(name for name in CLOUD_NAMES if name not in {"robust", "noise", *OPTIONAL_CLOUD})
GAPS = ("close_holes", "trim_distance", "trim_density")


class SPARSE_SURFACE_PT_advanced(SubPanel, Panel):
    bl_label = "Advanced"

    @classmethod
    def poll(cls, context: Context) -> bool:
        return bool(context.scene.sparse_surface.job != "MEASURE")

    def draw(self, context: Context) -> None:
        settings = context.scene.sparse_surface
        column = self.column(context)
        if settings.job == "RECONSTRUCT":
            draw_optional(column, settings.reconstruction, "ring")
            for name in POINTS:
                column.prop(settings.reconstruction, name)
            for name in GAPS:
                draw_optional(column, settings.reconstruction, name)
            column.prop(settings.reconstruction, "keep_base")
            column.separator()
        for name in (*PATCHES, *MORE):
            if not (name == "ring" and settings.job == "RECONSTRUCT"):  # the points have their own
                column.prop(settings, name)


class UnderAdvanced(SubPanel):
    bl_parent_id = "SPARSE_SURFACE_PT_advanced"


class SPARSE_SURFACE_PT_domain(UnderAdvanced, Panel):
    bl_label = "Domain and Regularisation"

    def draw(self, context: Context) -> None:
        column = self.column(context)
        for name in DOMAIN:
            column.prop(context.scene.sparse_surface, name)


class SPARSE_SURFACE_PT_paper(UnderAdvanced, Panel):
    bl_label = "Method of the Paper"

    def draw(self, context: Context) -> None:
        settings = context.scene.sparse_surface
        column = self.column(context)
        for name in PAPER:
            column.prop(settings, name)
        column.separator()
        read = METHODS[settings.method].own_settings
        for name in OF_ONE_METHOD:
            row = column.row()
            row.active = name in read
            row.prop(settings, name)


class SPARSE_SURFACE_PT_output(UnderAdvanced, Panel):
    bl_label = "Input and Output"

    def draw(self, context: Context) -> None:
        settings = context.scene.sparse_surface
        column = self.column(context)
        draw_weights(column, context)
        column.separator()
        column.prop(settings, "replace_result")
        column.prop(settings, "source_shown")
        column.prop(settings, "show_preview")
        kind = column.row()
        kind.active = settings.show_preview
        kind.prop(settings, "preview_kind")
        column.separator()
        for name in OUTPUT[:-2]:
            column.prop(settings, name)
        if settings.merge_vertices:
            draw_optional(column, settings, "merge_distance")
        draw_optional(column, settings, "workers")


CLASSES = (
    SPARSE_SURFACE_PT_advanced,
    SPARSE_SURFACE_PT_domain,
    SPARSE_SURFACE_PT_paper,
    SPARSE_SURFACE_PT_output,
)

register, unregister = bpy.utils.register_classes_factory(CLASSES)

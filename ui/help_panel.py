"""The panel Help, closed at first: what to do for the chosen job, and where to read on."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface_
from bpy.types import Context, Panel

from .menus import draw_help
from .sidebar import SubPanel, draw_lines

STEPS = {
    "APPROXIMATE": (
        "Select one or more meshes and press Approximate.",
        "The result takes the place of the mesh in view; Show Source brings the mesh back.",
        "Show Heat Map colours the result by its error. With a tolerance, patches get finer until it is kept.",
    ),
    "DENOISE": (
        "Select a scanned mesh and press Denoise.",
        "The noise level is estimated; give it if you know the scanner's.",
        "To get functions as well, choose to approximate after denoising.",
    ),
    "RECONSTRUCT": (
        "Select a point cloud, or a mesh of points without faces, and press Reconstruct.",
        "A base is made from the points; choose one if you have a coarse mesh near them.",
        "Each point gets its distance from the surface as a colour.",
    ),
    "MEASURE": (
        "Select a result to see its error, or two surfaces to see how far they are apart.",
        "The active one of two is coloured.",
        "Compare Methods approximates one mesh with two presets, side by side.",
    ),
}
"""For each job what to do, a sentence a step."""


class SPARSE_SURFACE_PT_help(SubPanel, Panel):
    bl_label = "Help"
    bl_order = 1

    def draw(self, context: Context) -> None:
        for number, step in enumerate(STEPS[context.scene.sparse_surface.job], start=1):
            draw_lines(self.layout, f"{number}. {iface_(step)}", "NONE")
        column = self.layout.column(align=True)
        column.operator("sparse_surface.open_sample", icon="SCENE_DATA")
        draw_help(column)


CLASSES = (SPARSE_SURFACE_PT_help,)

register, unregister = bpy.utils.register_classes_factory(CLASSES)

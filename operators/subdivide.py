"""The operator that makes coarse meshes fine enough to be approximated."""

from __future__ import annotations

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Operator

from .data.objects import selected_meshes
from .run.estimate import coarse_meshes, vertex_count
from .run.poll import needs, no_run, object_mode

ENOUGH = 400
"""Vertices at which a mesh has patches of several rings."""

MOST_LEVELS = 6


def coarse(context: Context) -> str:
    """A selected mesh is too coarse."""
    found = coarse_meshes(selected_meshes(context), context)
    return "" if found else rpt_("No selected mesh is too coarse")


class SPARSE_SURFACE_OT_subdivide(Operator):
    """Give coarse meshes a modifier that splits their faces and keeps their shape, so that they can be approximated"""

    bl_idname = "sparse_surface.subdivide"
    bl_label = "Subdivide"
    bl_options = {"REGISTER", "UNDO"}

    poll = needs(object_mode, no_run, coarse)

    def execute(self, context: Context) -> set[str]:
        for each in coarse_meshes(selected_meshes(context), context):
            modifier = each.modifiers.new("Subdivide", "SUBSURF")
            modifier.subdivision_type = "SIMPLE"
            context.scene.sparse_surface.use_modifiers = True
            for level in range(1, MOST_LEVELS + 1):
                modifier.levels = modifier.render_levels = level
                context.view_layer.update()
                if vertex_count(each, context) >= ENOUGH:
                    break
            text = rpt_("'{}': {} vertices by its modifier")
            self.report({"INFO"}, text.format(each.name, vertex_count(each, context)))
        return {"FINISHED"}

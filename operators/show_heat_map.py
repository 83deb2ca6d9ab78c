"""The operator that shows error colours in a viewport and restores what it showed before."""

from __future__ import annotations

from bpy.types import Context, Operator

from .heat_map.shown import restore, show, shows_heat_map
from .run.poll import heat_map, in_viewport, needs


class SPARSE_SURFACE_OT_show_heat_map(Operator):
    """Show the error of each vertex as its colour in this viewport; press again to return to the previous shading"""

    bl_idname = "sparse_surface.show_heat_map"
    bl_label = "Show Heat Map"
    bl_options = {"INTERNAL"}

    poll = needs(in_viewport, heat_map)

    def execute(self, context: Context) -> set[str]:
        from .heat_map.scale import recolour_scene  # NumPy-heavy: enabling the add-on loads this module

        space = context.space_data
        if shows_heat_map(space):
            restore(space)
        else:
            show(space, context)
            recolour_scene(context.scene)  # all that are visible share one range
        context.area.tag_redraw()
        return {"FINISHED"}

"""The operator that shows the points of a reconstruction in the colours of their errors, or hides them."""

from __future__ import annotations

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Object, Operator

from .data.origins import POINT_ERRORS, earlier, source_of
from .data.viewports import join_local_views
from .data.visibility import hide, show
from .heat_map.point_bodies import give_bodies
from .heat_map.shown import show_here
from .run.poll import needs, object_mode


def points_of(context: Context) -> Object | None:
    """Return the points with errors that belong to the active result, or are active themselves."""
    active = context.active_object
    source = source_of(active) if active is not None else None
    return earlier(source, POINT_ERRORS) if source is not None else None


def point_errors(context: Context) -> str:
    """The active object was reconstructed from points whose errors were kept."""
    return "" if points_of(context) is not None else rpt_("Select a surface that was reconstructed from points")


class SPARSE_SURFACE_OT_show_point_errors(Operator):
    bl_idname = "sparse_surface.show_point_errors"
    bl_label = "Show Point Errors"
    bl_description = (
        "Show the points that the active surface was made from, as small bodies in the colours of their errors. "
        "Press again to hide them"
    )
    bl_options = {"REGISTER", "UNDO"}

    poll = needs(object_mode, point_errors)

    def execute(self, context: Context) -> set[str]:
        points = points_of(context)
        assert points is not None
        if points.visible_get():
            hide(points, context)
            return {"FINISHED"}
        give_bodies(points)
        show(points, context)
        join_local_views(points, context.active_object, context)
        show_here(context)
        return {"FINISHED"}

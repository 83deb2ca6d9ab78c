"""The 3D viewports of all windows: what they show, and redrawing them."""

from __future__ import annotations

from collections.abc import Iterator

from bpy.types import Area, Context, Object, SpaceView3D


def viewports(context: Context) -> Iterator[Area]:
    """Iterate over the areas that are 3D viewports."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                yield area


def redraw_regions(context: Context, kind: str) -> None:
    """Redraw the regions of this type, such as "UI" or "WINDOW", of all 3D viewports."""
    for area in viewports(context):
        for region in area.regions:
            if region.type == kind:
                region.tag_redraw()


def is_shown_in(view: SpaceView3D, placed: Object, context: Context) -> bool:
    """Whether a viewport shows an object: neither it nor its collection is hidden, and it is in the local view."""
    depsgraph = context.view_layer.depsgraph
    # Blender 4 knows it of evaluated objects only.
    return depsgraph is not None and bool(placed.evaluated_get(depsgraph).visible_in_viewport_get(view))


def join_local_views(made: Object, beside: Object, context: Context) -> None:
    """Add an object to each local view that shows another."""
    for area in viewports(context):
        view = area.spaces.active
        if view.local_view is not None and _is_local_to(view, beside, context):
            made.local_view_set(view, True)


def _is_local_to(view: SpaceView3D, placed: Object, context: Context) -> bool:
    depsgraph = context.view_layer.depsgraph
    # Also where the object is hidden; Blender 4 knows it of evaluated objects only.
    return depsgraph is not None and bool(placed.evaluated_get(depsgraph).local_view_get(view))

"""The 3D viewports of all windows: what they show, and redrawing them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import bpy
from bpy.types import Area, Context, Object, Region, SpaceView3D
from bpy_extras.view3d_utils import region_2d_to_location_3d


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


class Drawing:
    """A function that Blender calls whenever it has drawn a 3D viewport.

    Parameters
    ----------
    draw
        Draws over the viewport of `bpy.context`.
    when
        "POST_PIXEL" to draw in pixels, "POST_VIEW" to draw in the scene.
    """

    def __init__(self, draw: Callable[[], None], when: str) -> None:
        self._draw, self._when = draw, when
        self._handle: object | None = None

    @property
    def going_on(self) -> bool:
        """Whether Blender calls the function."""
        return self._handle is not None

    def start(self) -> None:
        """Begin, where there is a window."""
        if self._handle is None and not bpy.app.background:
            self._handle = SpaceView3D.draw_handler_add(self._draw, (), "WINDOW", self._when)

    def stop(self) -> None:
        """End, if it was begun."""
        if self._handle is not None:
            SpaceView3D.draw_handler_remove(self._handle, "WINDOW")
            self._handle = None


def frame(objects: Sequence[Object], context: Context) -> None:
    """Turn no viewport, but move each so that all of these objects are seen; the selection stays as it is."""
    context.view_layer.update()
    layer = context.view_layer.objects
    before = [each for each in layer if each.select_get()]
    for each in layer:
        each.select_set(each in objects)
    for area in viewports(context):
        region = next(region for region in area.regions if region.type == "WINDOW")
        with context.temp_override(area=area, region=region):
            if bpy.ops.view3d.view_selected.poll():
                bpy.ops.view3d.view_selected()
                _make_room(area, region)
    for each in layer:
        each.select_set(each in before)


def sidebar_width(area: Area, context: Context) -> int:
    """Return how many pixels at the right of a viewport lie under its sidebar."""
    if not context.preferences.system.use_region_overlap:
        return 0
    sidebars = (region for region in area.regions if region.type == "UI" and region.alignment == "RIGHT")
    return max((region.width for region in sidebars if region.width > 1), default=0)


def _make_room(area: Area, region: Region) -> None:
    """Move what a viewport shows out from under its sidebar."""
    covered = sidebar_width(area, bpy.context)
    view = area.spaces.active.region_3d
    if not 0 < covered < region.width / 2:
        return
    view.view_distance *= region.width / (region.width - covered)
    view.update()
    middle = ((region.width + covered) / 2.0, region.height / 2.0)
    view.view_location = region_2d_to_location_3d(region, view, middle, view.view_location)
    view.update()


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

"""The operator that reads values off a heat map with the mouse."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Area, Context, Event, Operator, Region

from .data.lengths import length_text
from .data.viewports import redraw_regions, viewports
from .heat_map.readings import Reading, View, readings
from .heat_map.shown import shows_colours
from .run.poll import heat_map, in_viewport, needs, object_mode


class SPARSE_SURFACE_OT_read_values(Operator):
    bl_idname = "sparse_surface.read_values"
    bl_label = "Read Values"
    bl_description = (
        "Show the error or distance under the mouse, and where it was measured to. A click keeps the reading in view. "
        "Esc, right click or this button again ends it"
    )

    poll = needs(in_viewport, heat_map, object_mode)

    def invoke(self, context: Context, event: Event) -> set[str]:
        """Begin, with the heat map shown; end if it is going on."""
        if readings.going_on:
            readings.stop()  # the operator that reads sees it at its next event
            _redraw(context)
            return {"FINISHED"}
        if not shows_colours(context.space_data):
            bpy.ops.sparse_surface.show_heat_map()
        readings.start()
        context.window_manager.modal_handler_add(self)
        context.workspace.status_text_set(rpt_("Move: read  |  Click: keep the reading  |  Esc or right click: end"))
        _redraw(context)
        return {"RUNNING_MODAL"}

    def modal(self, context: Context, event: Event) -> set[str]:
        if not readings.going_on:
            return self._end(context)
        if event.type == "ESC" and event.value == "PRESS":
            return self._end(context)
        view = view_under(context, event.mouse_x, event.mouse_y) if context.mode == "OBJECT" else None
        if event.type == "MOUSEMOVE":
            self._look(context, view, event)
        if view is None or event.alt or event.shift or event.ctrl:
            return {"PASS_THROUGH"}
        if event.type == "RIGHTMOUSE" and event.value == "PRESS":
            return self._end(context)
        if event.type == "LEFTMOUSE" and event.value == "PRESS":
            self._look(context, view, event)
            kept = readings.keep()
            _redraw(context)
            if kept is not None:
                self.report({"INFO"}, sentence(kept, context))
            return {"RUNNING_MODAL"}
        return {"PASS_THROUGH"}

    def cancel(self, context: Context) -> None:
        """Forget the readings; Blender calls this when the window closes."""
        self._end(context)

    @staticmethod
    def _look(context: Context, view: View | None, event: Event) -> None:
        from .heat_map.probe import read_under  # NumPy-heavy: enabling the add-on loads this module

        found = None
        if view is not None:
            found = read_under(context, view, event.mouse_x - view.region.x, event.mouse_y - view.region.y)
        if found != readings.under_mouse:
            readings.under_mouse = found
            _redraw(context)

    def _end(self, context: Context) -> set[str]:
        readings.stop()
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        _redraw(context)
        return {"FINISHED"}


def sentence(reading: Reading, context: Context) -> str:
    """Say what was read, and where."""
    value = length_text(context.scene, reading.value)
    if reading.partner is None:
        return rpt_("{} at vertex {} of '{}'").format(value, reading.vertex, reading.name)
    where = ", ".join(length_text(context.scene, along) for along in reading.partner)
    return rpt_("{} from vertex {} of '{}' to ({})").format(value, reading.vertex, reading.name, where)


def view_under(context: Context, x: int, y: int) -> View | None:
    """Return the viewport with a heat map under a place of the window, if no other region lies over it there."""
    for area in viewports(context):
        over = [each for each in area.regions if _holds(each, x, y)]
        if area in list(context.window.screen.areas) and shows_colours(area.spaces.active) and len(over) == 1:
            return View(area.spaces.active, over[0], _data(area, over[0])) if over[0].type == "WINDOW" else None
    return None


def _data(area: Area, region: Region) -> Any:
    space = area.spaces.active
    quarters = [each for each in area.regions if each.type == "WINDOW"]
    return space.region_quadviews[quarters.index(region)] if len(space.region_quadviews) else space.region_3d


def _holds(region: Region, x: int, y: int) -> bool:
    inside = 0 <= x - region.x < region.width and 0 <= y - region.y < region.height
    return inside and region.width > 1 and region.height > 1


def _redraw(context: Context) -> None:
    redraw_regions(context, "WINDOW")
    redraw_regions(context, "UI")

"""The operator that shows error colours in a viewport and restores what it showed before."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Operator, SpaceView3D

from .data.result_keys import ERROR_COLOUR, has_heat_map
from .run.poll import needs

# Flat light shows the colours of the legend; the cavities keep the shape readable.
_HEAT_MAP_SHADING = {"color_type": "VERTEX", "light": "FLAT", "show_cavity": True, "cavity_type": "SCREEN"}


@dataclass
class Shading:
    """What a viewport showed before its heat map: its kind of shading, and how it showed solids."""

    kind: str
    solid: dict[str, Any]
    isolated: bool = False


_before: dict[int, Shading] = {}
"""By the address of the viewport's space; cleared when another file is loaded."""


def shows_heat_map(space: SpaceView3D | None) -> bool:
    """Whether a viewport shows error colours because of this operator."""
    return space is not None and space.as_pointer() in _before and space.shading.color_type == "VERTEX"


def anywhere_shown() -> bool:
    """Whether any viewport may show a heat map."""
    return bool(_before)


def in_viewport(context: Context) -> str:
    """The mouse is in a 3D viewport."""
    return "" if isinstance(context.space_data, SpaceView3D) else rpt_("Only in a 3D viewport")


def heat_map(context: Context) -> str:
    """The viewport shows a heat map, or the active object has one."""
    if shows_heat_map(context.space_data) or has_heat_map(context.active_object):
        return ""
    return rpt_("The active object has no heat map; approximate a mesh or compare two meshes first")


class SPARSE_SURFACE_OT_show_heat_map(Operator):
    """Show the error of each vertex as its colour in this viewport; press again to return to the previous shading"""

    bl_idname = "sparse_surface.show_heat_map"
    bl_label = "Show Heat Map"
    bl_options = {"INTERNAL"}

    poll = needs(in_viewport, heat_map)

    def execute(self, context: Context) -> set[str]:
        space = context.space_data
        if shows_heat_map(space):
            _restore(space)
        else:
            _show(space, context)
        context.area.tag_redraw()
        return {"FINISHED"}


def _show(space: SpaceView3D, context: Context) -> None:
    shading = space.shading
    kind, shading.type = shading.type, "SOLID"  # the choices of solid shading can be read only when it is on
    before = Shading(kind, {name: getattr(shading, name) for name in _HEAT_MAP_SHADING})
    for name, value in _HEAT_MAP_SHADING.items():
        setattr(shading, name, value)
    for candidate in context.view_layer.objects:
        if has_heat_map(candidate):
            colours = candidate.data.color_attributes
            colours.active_color_index = colours.find(ERROR_COLOUR)
    if context.scene.sparse_surface.display.isolate and space.local_view is None:
        before.isolated = _isolate(space, context)
    _before[space.as_pointer()] = before


def _isolate(space: SpaceView3D, context: Context) -> bool:
    """Show only objects with a heat map, in the viewport's local view."""
    if bpy.ops.view3d.localview(frame_selected=False) != {"FINISHED"}:
        return False
    for candidate in context.view_layer.objects:
        candidate.local_view_set(space, has_heat_map(candidate))
    return True


def _restore(space: SpaceView3D) -> None:
    before = _before.pop(space.as_pointer())
    for name, value in before.solid.items():
        setattr(space.shading, name, value)
    space.shading.type = before.kind
    if before.isolated and space.local_view is not None:
        bpy.ops.view3d.localview(frame_selected=False)


def forget() -> None:
    """Forget what viewports showed before: they are gone."""
    _before.clear()

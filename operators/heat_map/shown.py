"""Which viewports show error colours, and what each showed before.  Needs no NumPy: the panel asks here.

While Blender runs, a viewport is known by the address of its space, which undo, redo and changes of mode leave alone.
Before a file is saved or replaced, that goes into a custom property of the screens; afterwards it is read from there.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import bpy
from bpy.types import Context, Object, PropertyGroup, Scene, SpaceView3D

from ..data.result_keys import EARLY, ERROR_COLOUR, has_heat_map
from ..data.viewports import viewports

STATE = "sparse_surface_heat_map"
"""Custom property of a screen: for each of its areas with a heat map, by its number, what it showed before, as JSON."""

# Flat light shows the colours of the legend; the cavities keep the shape readable.
_SHADING = {"color_type": "VERTEX", "light": "FLAT", "show_cavity": True, "cavity_type": "SCREEN"}


@dataclass(eq=False, repr=False)
class Before:
    """What a viewport showed before: its kind of shading, how it showed solids, and what has changed since."""

    kind: str
    solid: dict[str, Any]
    isolated: bool = False
    for_patches: bool = False


_before: dict[int, Before] = {}
"""By the address of the viewport's space."""


def shows_colours(space: SpaceView3D | None) -> bool:
    """Whether a viewport shows the colours of errors or patches because of the add-on."""
    if space is None or space.as_pointer() not in _before:
        return False
    return bool(space.shading.type == "SOLID" and space.shading.color_type == "VERTEX")


def shows_heat_map(space: SpaceView3D | None) -> bool:
    """Whether a viewport shows error colours because Show Heat Map was pressed."""
    return space is not None and shows_colours(space) and not _before[space.as_pointer()].for_patches


def shows_for_patches(space: SpaceView3D) -> bool:
    """Whether a viewport shows colours only because Show Patches was pressed."""
    return shows_colours(space) and _before[space.as_pointer()].for_patches


def anywhere_shown() -> bool:
    """Whether any viewport may show a heat map."""
    return bool(_before)


def show(space: SpaceView3D, context: Context, *, for_patches: bool = False) -> None:
    """Show the colours in a viewport, and note what it showed before."""
    shading, earlier = space.shading, _before.get(space.as_pointer())
    if shows_colours(space) and earlier is not None:
        earlier.for_patches = for_patches
    else:
        kind, shading.type = shading.type, "SOLID"  # the choices of solid shading can be read only when it is on
        if earlier is not None and shading.color_type == "VERTEX":  # another kind of shading was chosen meanwhile
            earlier.kind, earlier.for_patches = kind, for_patches
        else:
            solid = {name: getattr(shading, name) for name in _SHADING}
            isolated = earlier is not None and earlier.isolated
            _before[space.as_pointer()] = Before(kind, solid, isolated, for_patches)
        for name, value in _SHADING.items():
            setattr(shading, name, value)
    if not for_patches:
        for candidate in heat_maps(context):
            choose_colours(candidate, ERROR_COLOUR)
    isolate(space, context)


def shown_tolerance(scene: Scene) -> float:
    """Return the tolerance that separates inside from outside, 0 where errors are shown on the ramp."""
    settings: PropertyGroup = scene.sparse_surface
    if not settings.display.inside_outside:
        return 0.0
    return settings.tolerance or settings.display.tolerance


def show_here(context: Context) -> None:
    """Show heat maps in the viewport in which the operator was called, if it was in one."""
    space = context.space_data
    if isinstance(space, SpaceView3D):
        if not shows_heat_map(space):
            show(space, context)
        context.area.tag_redraw()


def restore(space: SpaceView3D) -> None:
    """Return a viewport to what it showed before."""
    before = _before.pop(space.as_pointer())
    for name, value in before.solid.items():
        setattr(space.shading, name, value)
    space.shading.type = before.kind
    if not _before:
        for candidate in heat_maps(bpy.context):
            index = candidate.data.color_attributes.render_color_index
            if index >= 0:  # the user's own colours, where there are some
                choose_colours(candidate, candidate.data.color_attributes[index].name)
    if before.isolated and space.local_view is not None:
        bpy.ops.view3d.localview(frame_selected=False)


def choose_colours(shown: Object, name: str) -> None:
    """Let viewports show these colours of an object; renders keep those that they have."""
    colours = shown.data.color_attributes
    index = colours.find(name)
    if index >= 0 and index != colours.active_color_index:
        colours.active_color_index = index


def isolate(space: SpaceView3D, context: Context) -> None:
    """Show only objects with a heat map in the context's viewport, in its local view, if the scene says so."""
    before, wanted = _before[space.as_pointer()], context.scene.sparse_surface.display.isolate
    if wanted and space.local_view is None:
        before.isolated = bpy.ops.view3d.localview(frame_selected=False) == {"FINISHED"}
        if before.isolated:
            for candidate in context.view_layer.objects:
                candidate.local_view_set(space, has_heat_map(candidate))
    elif not wanted and before.isolated:
        before.isolated = False
        if space.local_view is not None:
            bpy.ops.view3d.localview(frame_selected=False)


def isolate_everywhere(context: Context) -> None:
    """Do so in every viewport that shows a heat map: the scene's choice has changed."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D" and shows_colours(area.spaces.active):
                region = next(region for region in area.regions if region.type == "WINDOW")
                with context.temp_override(window=window, area=area, region=region):
                    isolate(area.spaces.active, context)


def join_local_views(context: Context) -> None:
    """Add every heat map to the local views that show only heat maps: new ones, and those that undo brought back."""
    for area in viewports(context):
        space = area.spaces.active
        before = _before.get(space.as_pointer())
        if before is not None and before.isolated and space.local_view is not None:
            for candidate in heat_maps(context):
                candidate.local_view_set(space, True)


def heat_maps(context: Context) -> Iterator[Object]:
    """Iterate over the finished objects with a heat map in the view layer."""
    return (each for each in context.view_layer.objects if has_heat_map(each) and EARLY not in each)


@bpy.app.handlers.persistent
def remember(*_: object) -> None:
    """Write into the screens what their viewports showed before."""
    for screen in bpy.data.screens:
        found = {
            str(number): asdict(_before[area.spaces.active.as_pointer()])
            for number, area in enumerate(screen.areas)
            if area.type == "VIEW_3D" and area.spaces.active.as_pointer() in _before
        }
        if found:
            screen[STATE] = json.dumps(found)
        elif STATE in screen:
            del screen[STATE]


@bpy.app.handlers.persistent
def recall(*_: object) -> None:
    """Read from the screens of this file what their viewports showed before."""
    _before.clear()
    for screen in bpy.data.screens:
        for number, before in json.loads(screen.get(STATE, "{}")).items():
            area = screen.areas[int(number)] if int(number) < len(screen.areas) else None
            if area is not None and area.type == "VIEW_3D":
                _before[area.spaces.active.as_pointer()] = Before(**before)


_HANDLERS = {
    "save_pre": remember,
    "load_pre": remember,
    "load_post": recall,
}


def register() -> None:
    """Be told of saving and loading."""
    for name, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)
    if hasattr(bpy.data, "screens"):  # not while Blender starts; then a file is loaded afterwards
        recall()


def unregister() -> None:
    """Undo `register`; the state stays in the screens."""
    remember()
    for name, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    _before.clear()

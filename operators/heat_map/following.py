"""Keeps heat maps true while they are shown: one range for all that are visible, and none hidden by a local view."""

from __future__ import annotations

import bpy
from bpy.types import Context

from ..data.result_keys import SCALE
from .shown import anywhere_shown, heat_maps, join_local_views

AT_ONCE, LATER = ("depsgraph_update_post", "load_post"), ("undo_post", "redo_post")
"""Handlers after which the objects are as they stay, and handlers after which Blender still changes local views."""

_seen: list[tuple[int, tuple[float, ...]]] = []
"""The visible heat maps with their ranges, as they were last seen."""


@bpy.app.handlers.persistent
def follow(*_: object) -> None:
    """Give the visible heat maps a common range again if one of them appeared, vanished or changed."""
    context = bpy.context
    if not anywhere_shown() or context.mode != "OBJECT" or context.scene is None or _visible(context) == _seen:
        return
    from .scale import recolour_scene  # NumPy-heavy: enabling the add-on loads this module

    join_local_views(context)
    recolour_scene(context.scene)
    _seen[:] = _visible(context)


@bpy.app.handlers.persistent
def follow_later(*_: object) -> None:
    """Look again as soon as Blender has finished what it is doing."""
    if anywhere_shown() and not bpy.app.timers.is_registered(_look_again):
        bpy.app.timers.register(_look_again)


def _look_again() -> None:
    _seen.clear()
    follow()


def _visible(context: Context) -> list[tuple[int, tuple[float, ...]]]:
    return [(each.session_uid, tuple(each[SCALE])) for each in heat_maps(context) if each.visible_get()]


def register() -> None:
    """Be told of changes, undo and loading."""
    for name in AT_ONCE:
        getattr(bpy.app.handlers, name).append(follow)
    for name in LATER:
        getattr(bpy.app.handlers, name).append(follow_later)


def unregister() -> None:
    """Undo `register`."""
    for name in AT_ONCE:
        getattr(bpy.app.handlers, name).remove(follow)
    for name in LATER:
        getattr(bpy.app.handlers, name).remove(follow_later)
    if bpy.app.timers.is_registered(_look_again):
        bpy.app.timers.unregister(_look_again)
    _seen.clear()

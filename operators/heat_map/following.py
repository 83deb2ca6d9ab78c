"""Keeps heat maps true while they are shown: one range for all that are visible, and none hidden by a local view."""

from __future__ import annotations

import bpy
from bpy.types import Context

from ..data.result_keys import SCALE
from .shown import anywhere_shown, heat_maps, join_local_views

HANDLERS = ("depsgraph_update_post", "undo_post", "redo_post", "load_post")

_seen: list[tuple[int, tuple[float, ...]]] = []
"""The visible heat maps with their ranges, as they were last seen."""


@bpy.app.handlers.persistent
def follow(*_: object) -> None:
    """Give the visible heat maps a common range again if one of them appeared, vanished or changed."""
    context = bpy.context
    if not anywhere_shown() or context.mode != "OBJECT" or context.scene is None:
        return
    join_local_views(context)
    if _visible(context) == _seen:
        return
    from .scale import recolour_scene  # NumPy-heavy: enabling the add-on loads this module

    recolour_scene(context.scene)
    _seen[:] = _visible(context)


def _visible(context: Context) -> list[tuple[int, tuple[float, ...]]]:
    return [(each.session_uid, tuple(each[SCALE])) for each in heat_maps(context) if each.visible_get()]


def register() -> None:
    """Be told of changes, undo and loading."""
    for name in HANDLERS:
        getattr(bpy.app.handlers, name).append(follow)


def unregister() -> None:
    """Undo `register`."""
    for name in HANDLERS:
        getattr(bpy.app.handlers, name).remove(follow)
    _seen.clear()

"""Notices at once when an object that is being solved is deleted or edited: its result would be of no use."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from zlib import crc32

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Object

from ..data.objects import find_object

_touched: set[int] = set()
"""Session numbers of objects and meshes whose geometry Blender has evaluated again since a watch last looked."""


class Watch:
    """Looks after the objects from which sources were read.

    Playing an animation does not count as editing: what is compared is the mesh before modifiers and shape keys.

    Parameters
    ----------
    sources
        Each of one object, a `Source` or a `CloudSource`.
    """

    def __init__(self, sources: Iterable[Any]) -> None:
        _touched.clear()
        self._names = {source.session_uid: source.name for source in sources}
        found = ((uid, find_object(uid)) for uid in self._names)
        self._marks = {uid: _fingerprint(placed) for uid, placed in found if placed is not None}

    def lost(self) -> dict[int, str]:
        """Return the session numbers of objects that were deleted or edited, each with a sentence; each only once."""
        sentences = {}
        for uid, name in self._names.items():
            placed = find_object(uid)
            if placed is None or not placed.users_scene:
                sentences[uid] = rpt_("'{}' was deleted, so there is no surface of it.").format(name)
            elif {uid, placed.data.session_uid} & _touched and _fingerprint(placed) != self._marks.get(uid):
                sentences[uid] = rpt_("'{}' was edited, so the run for it has ended. Run it again.").format(placed.name)
        for uid in sentences:
            del self._names[uid]
        _touched.clear()
        return sentences


def _fingerprint(placed: Object) -> tuple[object, ...]:
    """Return what changes when an object's own geometry or its list of modifiers does."""
    modifiers = tuple((each.name, each.type, each.show_viewport) for each in placed.modifiers)
    if placed.type != "MESH":
        return modifiers
    from ..data.meshes import read_polygons, read_positions  # NumPy-heavy: enabling the add-on loads this module

    if placed.mode == "EDIT":
        placed.update_from_editmode()
    corners, sizes = read_polygons(placed.data)
    return (*modifiers, *(crc32(each.tobytes()) for each in (read_positions(placed.data), corners, sizes)))


@bpy.app.handlers.persistent
def _note_changes(_: object, depsgraph: Any) -> None:
    _touched.update(change.id.original.session_uid for change in depsgraph.updates if change.is_updated_geometry)


def register() -> None:
    """Have Blender tell what it has evaluated again."""
    bpy.app.handlers.depsgraph_update_post.append(_note_changes)


def unregister() -> None:
    """Leave no handler behind."""
    bpy.app.handlers.depsgraph_update_post.remove(_note_changes)

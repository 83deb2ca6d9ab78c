"""Drafts become compact: in the background with a window, and before a file is saved without one.

To make a representation compact takes longer than to solve the surface, so a new result holds a draft: the same
functions, in five to ten times the bytes.  Everything that reads a representation reads a draft, too.
"""

from __future__ import annotations

import atexit
import hashlib
from collections.abc import Sequence
from concurrent.futures import Executor, Future
from importlib import import_module
from typing import Any

import bpy
from bpy.types import ID, Object

from ..data.result_keys import DRAFT, REPRESENTATION, store_representation

BETWEEN = 0.5
"""Seconds between two looks for what is done."""

_waiting: dict[bytes, Future[bytes]] = {}
"""What children are making compact, by the drafts' digests."""

_known: dict[bytes, bytes] = {}
"""The compact form of drafts, by their digests: undoing and redoing brings drafts back."""

_children: list[Executor] = []


def compact_drafts(holders: Sequence[Object] = ()) -> None:
    """Make drafts compact here and now: those of these objects, or all in the file."""
    for holder in [each for each in _drafts() if not holders or each in holders]:
        draft = holder[REPRESENTATION]
        store_representation(holder, _known.get(_digest(draft)) or _job().compacted(draft), draft=False)


def begin(python: Sequence[str]) -> None:
    """Have a child make compact what is not yet, and take it in when it is done."""
    _store_known()
    fresh = {_digest(each[REPRESENTATION]): each[REPRESENTATION] for each in _drafts()}
    fresh = {digest: draft for digest, draft in fresh.items() if digest not in _waiting}
    if fresh:
        child, futures = _job().begin_compacting(list(fresh.values()), python)
        _children.append(child)
        _waiting.update(zip(fresh, futures, strict=True))
    if _waiting and not bpy.app.timers.is_registered(_look):
        bpy.app.timers.register(_look, first_interval=BETWEEN, persistent=True)


def _look() -> float | None:
    """Take in what is done; a draft of which nothing could be made stays one."""
    done = [digest for digest, future in _waiting.items() if future.done()]
    for digest in done:
        future = _waiting.pop(digest)
        if not future.cancelled() and future.exception() is None:
            _known[digest] = future.result()
    if done:
        _store_known()
    if not _waiting:
        _children.clear()
    return BETWEEN if _waiting else None


def _store_known() -> None:
    for holder in _drafts() if _known else ():
        compact = _known.get(_digest(holder[REPRESENTATION]))
        if compact is not None:
            store_representation(holder, compact, draft=False)


def _stop() -> None:
    """End the children."""
    _waiting.clear()
    _known.clear()
    while _children:
        _children.pop().shutdown(wait=False, cancel_futures=True)


def _digest(draft: bytes) -> bytes:
    return hashlib.sha256(draft).digest()


def _drafts() -> list[ID]:
    """Return the objects with a draft, and the meshes that keep one for the parts of a surface."""
    holders = (*bpy.data.objects, *(each for each in bpy.data.meshes if each.users))
    own = (each for each in holders if each.library is None and DRAFT in each)
    return [each for each in own if isinstance(each.get(REPRESENTATION), bytes)]


def _job() -> Any:
    """Return the module that solves, which takes its time to load: enabling the add-on loads this one."""
    return import_module("...solver.job", __package__)


@bpy.app.handlers.persistent
def _before_saving(*_: Any) -> None:
    """Leave no draft in the file; with a window nobody waits for that, and what is not done is saved as a draft."""
    if bpy.app.background:
        compact_drafts()
    else:
        _look()
        _store_known()


def register() -> None:
    """Be told before a file is saved."""
    bpy.app.handlers.save_pre.append(_before_saving)
    atexit.register(_stop)


def unregister() -> None:
    """Forget what is not done."""
    bpy.app.handlers.save_pre.remove(_before_saving)
    if bpy.app.timers.is_registered(_look):
        bpy.app.timers.unregister(_look)
    atexit.unregister(_stop)
    _stop()

"""Which object was made from which: ids that are stored with both.  Needs no NumPy: the panel asks here.

Names change and pointers would keep deleted objects alive, so a source carries an id, and what is made from it carries
the same one as its origin.  Copies of an object carry its id too: the id belongs to the oldest of them, and another one
gets an id of its own as soon as something is made from it, or the file is saved.
"""

from __future__ import annotations

from collections.abc import Iterator
from uuid import uuid4

import bpy
from bpy.types import Object

IDENTITY = "sparse_surface_id"
"""Custom property of an object that something was made from: its id."""

SOURCE = "sparse_surface_source"
"""Custom property of an object that was made: the id of the object that it was made from."""

ROLE = "sparse_surface_role"
"""Custom property of an object that was made: what it is to its source; making it again replaces it."""

RESULT, RESAMPLED, PATCH = "result", "resampled", "patch"
POINT_ERRORS, BASE = "point errors", "base"
DISTANCE = "distance from "
"""Beginning of the role of measured distances; the id of what they were measured from follows."""
COMPARED = ("compared 1", "compared 2")

ACCOMPANYING = {POINT_ERRORS, BASE}
"""What is shown together with a result, in the same place."""


def identity(source: Object) -> str:
    """Return the id of an object; it gets one if it has none of its own."""
    if source.library is not None:  # cannot be written, and its name is its identity there
        return f"{source.library.filepath}/{source.name}"
    stored = source.get(IDENTITY)
    if stored is None or owner_of(stored) != source:
        source[IDENTITY] = stored = uuid4().hex
    return str(stored)


def note_origin(made: Object, source: Object, role: str) -> None:
    """Store what an object was made from, and what it is to it."""
    made[SOURCE], made[ROLE] = identity(source), role


def was_made(candidate: Object | None) -> bool:
    """Whether an object was made from another."""
    return candidate is not None and SOURCE in candidate


def source_of(made: Object) -> Object | None:
    """Return the object that another was made from, if it still exists."""
    stored = made.get(SOURCE)
    return owner_of(stored) if stored is not None else None


def earlier(source: Object, role: str) -> Object | None:
    """Return what was made from a source before in this role, if it still exists; of copies, the oldest."""
    return next((made for made in made_from(source) if made.get(ROLE) == role), None)


def made_from(source: Object) -> list[Object]:
    """Return what was made from an object, the oldest first."""
    own = identity(source)
    return sorted((o for o in bpy.data.objects if o.get(SOURCE) == own and o.library is None), key=_age)


def family(member: Object) -> list[Object]:
    """Return an object with all that it was made from and all that was made from these."""
    first, seen = member, {member}
    while (source := source_of(first)) is not None and source not in seen:
        first = source
        seen.add(first)
    return list(_descendants(first))


def _descendants(first: Object) -> Iterator[Object]:
    """Iterate over an object and what was made from it; no object occurs twice, whatever a user stored in them."""
    waiting, seen = [first], {first}
    while waiting:
        yield (current := waiting.pop())
        if current.library is None and IDENTITY not in current:
            continue
        following = [made for made in made_from(current) if made not in seen]
        seen.update(following)
        waiting += following


def free(made: Object) -> None:
    """Forget what an object was made from."""
    for name in (SOURCE, ROLE):
        if name in made:
            del made[name]


def owner_of(stored: str) -> Object | None:
    """Return the object to which an id belongs, if it still exists: copies are younger."""
    linked = (o for o in bpy.data.objects if o.library is not None and identity(o) == stored)
    own = (o for o in bpy.data.objects if o.library is None and o.get(IDENTITY) == stored)
    return min([*own, *linked], key=_age, default=None)


def _age(candidate: Object) -> int:
    return int(candidate.session_uid)


@bpy.app.handlers.persistent
def _separate_copies(*_: object) -> None:
    """Give copies ids of their own: the session numbers that tell their age do not outlive the session."""
    owners: dict[str, Object] = {}
    for candidate in sorted((o for o in bpy.data.objects if o.library is None and IDENTITY in o), key=_age):
        if owners.setdefault(candidate[IDENTITY], candidate) != candidate:
            candidate[IDENTITY] = uuid4().hex


def register() -> None:
    """Separate copies before a file is saved."""
    bpy.app.handlers.save_pre.append(_separate_copies)


def unregister() -> None:
    """Leave no handler behind."""
    bpy.app.handlers.save_pre.remove(_separate_copies)

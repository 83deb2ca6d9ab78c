"""Results that take the places of their sources in a file: names, and places in the hierarchy."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence

from bpy.types import Object


@contextlib.contextmanager
def standing_in(objects: Sequence[Object], models: Sequence[Object]) -> Iterator[None]:
    """Let objects and their meshes have the names of others for a while, and their children, if each has one."""
    if len(objects) != len(models) or len({*objects, *models}) != 2 * len(objects):
        yield
        return
    with _named_like(objects, models), _parents_replaced(objects, models):
        yield


def placing(objects: Sequence[Object]) -> set[Object]:
    """Return the empty objects that say where these are: their parents, and the parents of these."""
    found: set[Object] = set()
    for each in objects:
        above = each.parent
        while above is not None and above not in found:
            if above.type == "EMPTY":
                found.add(above)
            above = above.parent
    return found


@contextlib.contextmanager
def _named_like(objects: Sequence[Object], models: Sequence[Object]) -> Iterator[None]:
    pairs = list(zip(objects, models, strict=True))
    before = [(each, each.name, each.data, each.data.name) for pair in pairs for each in pair]
    wanted = [(model.name, model.data.name) for model in models]
    for model, (name, _) in zip(models, wanted, strict=True):
        model.name = model.data.name = f"{name} source"  # some formats write a parent although it is not selected
    for each, (name, mesh) in zip(objects, wanted, strict=True):
        each.name, each.data.name = name, mesh
    try:
        yield
    finally:
        for each in objects:
            each.name = each.data.name = "written"
        for each, name, mesh, mesh_name in reversed(before):
            each.name, mesh.name = name, mesh_name


@contextlib.contextmanager
def _parents_replaced(objects: Sequence[Object], models: Sequence[Object]) -> Iterator[None]:
    """Let the children of models be those of the objects in their places, which stand where they stand."""
    instead = dict(zip(models, objects, strict=True))
    moved = [(each, each.parent) for each in objects if each.parent in instead]
    for each, parent in moved:
        each.parent = instead[parent]
    try:
        yield
    finally:
        for each, parent in moved:
            each.parent = parent

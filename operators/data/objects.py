"""Objects in the scene: which ones the user means, and where new ones belong.  Needs no NumPy: the panel asks here."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import bpy
from bpy.types import Collection, Context, Mesh, Object

from .origins import earlier, note_origin, source_of, was_made
from .viewports import join_local_views
from .visibility import BESIDE, HIDDEN


def chosen_objects(context: Context) -> list[Object]:
    """Return the selected objects; where there is none, the active one if it was hidden for its result.

    Blender selects no hidden object, but the outliner and scripts make it active.
    """
    chosen = list(context.selected_objects)
    active = context.view_layer.objects.active
    return [active] if not chosen and active is not None and HIDDEN in active else chosen


def selected_meshes(context: Context) -> list[Object]:
    """Return the chosen mesh objects, sorted by name so that their order does not depend on the scene's."""
    return sorted((o for o in chosen_objects(context) if o.type == "MESH"), key=lambda o: o.name)


def selected_points(context: Context) -> Object | None:
    """Return the object whose points to reconstruct: the active one, or another selected one if that is the base."""
    base = context.scene.sparse_surface.reconstruction.base
    chosen = sorted(chosen_objects(context), key=lambda o: (o != context.active_object, o.name))
    found = next((o for o in chosen if o.type in {"MESH", "POINTCLOUD"} and o != base), None)
    return found and (last_source(found, _has_points) or found)


def source_to_solve(chosen: Object) -> Object | None:
    """Return the mesh that is approximated where an object is selected: what a result was made from, or the object.

    None where what it was made from is gone.  A surface of points is itself a mesh to approximate.
    """
    if was_made(chosen) and source_of(chosen) is None:
        return None
    return last_source(chosen, has_faces) or chosen


def chosen_results(context: Context) -> Iterator[tuple[Object, Object]]:
    """Iterate over the selected objects that were made from another which still exists, with that one."""
    active = context.active_object
    for made in dict.fromkeys([*([active] if active is not None else []), *context.selected_objects]):
        if was_made(made) and (source := source_of(made)) is not None:
            yield made, source


def last_source(made: Object, suits: Callable[[Object], bool]) -> Object | None:
    """Return the first object in the line of those that an object was made from, of those that suit."""
    found, current, seen = None, source_of(made), {made}
    while current is not None and current not in seen and suits(current):
        found = current
        seen.add(current)
        current = source_of(current)
    return found


def has_faces(candidate: Object) -> bool:
    """Whether an object is a mesh that has faces, or may get some from its modifiers."""
    return candidate.type == "MESH" and bool(candidate.data.polygons or candidate.modifiers)


def _has_points(candidate: Object) -> bool:
    return candidate.type in {"MESH", "POINTCLOUD"}


def find_object(session_uid: int) -> Object | None:
    """Return the object with this session number, if it still exists."""
    return next((candidate for candidate in bpy.data.objects if candidate.session_uid == session_uid), None)


def parts_of(source: Any) -> Sequence[Any]:
    """Return the sources that were read as one (`Parts`), or the only one, each of one object."""
    return getattr(source, "parts", (source,))


def current_name(source: Any) -> str:
    """Return the names of the objects that a source was read from, as they are called now."""
    found = ((find_object(each.session_uid), each) for each in parts_of(source))
    return " + ".join(each.name if placed is None else placed.name for placed, each in found)


def create_object(
    name: str, mesh: Mesh, source: Object, context: Context, *, role: str = "", replace: bool = False
) -> Object:
    """Make an object of a mesh in the place of its source.

    Parameters
    ----------
    role
        What the object is to its source; empty for one that is not to be found again.
    replace
        Give the mesh to the object that has this role already, if there is one.
    """
    made = earlier(source, role) if role and replace else None
    if made is not None and made.type == "MESH":
        old, made.data = made.data, mesh
        if old.users == 0:
            bpy.data.meshes.remove(old)
        mesh.name = made.name
        made.pop(BESIDE, None)
        if not made.users_scene:  # deleted, but something still refers to it
            _link_beside(made, source, context)
    else:
        made = bpy.data.objects.new(name, mesh)
        _link_beside(made, source, context)
    _place_like(made, source)
    if role:
        note_origin(made, source, role)
    return made


def _link_beside(made: Object, beside: Object, context: Context) -> None:
    """Link an object into the collections of another, or the scene's where those are read-only, and its local views."""
    editable: list[Collection] = [c for c in beside.users_collection if c.is_editable]
    for collection in editable or [context.scene.collection]:
        collection.objects.link(made)
    join_local_views(made, beside, context)


def _place_like(made: Object, model: Object) -> None:
    """Give an object the place of another in the world, and its parent, so that both follow the same moves."""
    made.parent = model.parent
    made.parent_type = "OBJECT" if model.parent_type in {"ARMATURE", "LATTICE"} else model.parent_type
    made.parent_bone = model.parent_bone
    if model.parent_type.startswith("VERTEX"):
        made.parent_vertices = model.parent_vertices
    made.matrix_parent_inverse = model.matrix_parent_inverse
    made.rotation_mode = model.rotation_mode
    made.matrix_world = model.matrix_world


def select_only(context: Context, objects: list[Object]) -> None:
    """Select these objects, the last one active, and nothing else."""
    context.view_layer.update()
    for other in context.view_layer.objects.selected[:]:
        other.select_set(False)
    visible = [made for made in objects if context.view_layer.objects.get(made.name) == made]
    for made in visible:
        made.select_set(True)
    if visible:
        context.view_layer.objects.active = visible[-1]


def marked_objects(mark: str) -> list[Object]:
    """Return the objects of this file that have a custom property."""
    return [candidate for candidate in bpy.data.objects if mark in candidate and candidate.library is None]


def remove_marked(mark: str) -> None:
    """Remove the objects with a custom property, and their meshes if nothing else uses them."""
    remove_objects(marked_objects(mark))


def remove_objects(objects: Sequence[Object]) -> None:
    """Remove objects, and their meshes and texts if nothing else uses them."""
    kinds = {"MESH": bpy.data.meshes, "FONT": bpy.data.curves}
    held = {candidate.data: kinds[candidate.type] for candidate in objects if candidate.type in kinds}
    bpy.data.batch_remove(objects)
    for data, kind in held.items():
        if data.users == 0:
            kind.remove(data)

"""Objects in the scene: which ones the user means, and where new ones belong.  Needs no NumPy: the panel asks here."""

from __future__ import annotations

import bpy
from bpy.types import Collection, Context, Mesh, Object

from .viewports import join_local_views


def selected_meshes(context: Context) -> list[Object]:
    """Return the selected mesh objects, sorted by name so that their order does not depend on the scene's."""
    return sorted((o for o in context.selected_objects if o.type == "MESH"), key=lambda o: o.name)


def selected_points(context: Context) -> Object | None:
    """Return the object whose points to reconstruct: the active one, or another selected one if that is the base."""
    base = context.scene.sparse_surface.reconstruction.base
    chosen = sorted(context.selected_objects, key=lambda o: (o != context.active_object, o.name))
    return next((o for o in chosen if o.type in {"MESH", "POINTCLOUD"} and o != base), None)


def find_object(session_uid: int) -> Object | None:
    """Return the object with this session number, if it still exists."""
    return next((candidate for candidate in bpy.data.objects if candidate.session_uid == session_uid), None)


def create_object(name: str, mesh: Mesh, beside: Object, context: Context, *, instead: str = "") -> Object:
    """Make an object of a mesh in the place of another object.

    Parameters
    ----------
    instead
        Custom property that marks objects of an earlier run: if one of them has this name, it gets the mesh.
    """
    earlier = bpy.data.objects.get(name) if instead else None
    if earlier is not None and earlier.type == "MESH" and instead in earlier and earlier.library is None:
        made, old, earlier.data = earlier, earlier.data, mesh
        if old.users == 0:
            bpy.data.meshes.remove(old)
        mesh.name = name
    else:
        made = bpy.data.objects.new(name, mesh)
        _link_beside(made, beside, context)
    _place_like(made, beside)
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
    marked = marked_objects(mark)
    meshes = {candidate.data for candidate in marked if candidate.type == "MESH"}
    for candidate in marked:
        bpy.data.objects.remove(candidate)
    for mesh in meshes:
        if mesh.users == 0:
            bpy.data.meshes.remove(mesh)

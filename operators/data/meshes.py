"""The bridge: everything that turns Blender's meshes into arrays and arrays into meshes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import bpy
import numpy as np
from bpy.types import Collection, Context, Depsgraph, Mesh, Object
from numpy.typing import NDArray

from ...solver.errors import InputError
from ...solver.interchange import MeshArrays
from .colours import ColourScale
from .result_keys import DOMAIN_STRETCH, ERROR, ERROR_COLOUR, PATCH, REPORT, REPRESENTATION, SCALE, STRETCH, result_name
from .shape_keys import add_iteration_keys
from .sharp_edges import mark_sharp
from .viewports import join_local_views

# Layers of every result: name, type, domain, and how values are handed to `foreach_set`.
_LAYERS = (
    (ERROR, "FLOAT", "POINT", "value"),
    (ERROR_COLOUR, "FLOAT_COLOR", "POINT", "color"),
    (PATCH, "INT", "POINT", "value"),
    (DOMAIN_STRETCH, "FLOAT", "FACE", "value"),
)
_OTHER_NAME = "{} (source)"
_LAYER = {name: (kind, domain, value) for name, kind, domain, value in _LAYERS}


class Stored(Protocol):
    """What has the bytes of a saved representation."""

    @property
    def stored(self) -> bytes: ...


class Result(Protocol):
    """What the solver brings back, from this process or from a child."""

    @property
    def vertices(self) -> NDArray[np.floating[Any]]: ...
    @property
    def error(self) -> NDArray[np.floating[Any]]: ...
    @property
    def patch(self) -> NDArray[np.int32]: ...
    @property
    def domain_stretch(self) -> NDArray[np.floating[Any]]: ...
    @property
    def report(self) -> dict[str, Any]: ...
    @property
    def representation(self) -> Stored: ...
    @property
    def history(self) -> NDArray[np.floating[Any]] | None: ...
    @property
    def creases(self) -> NDArray[np.integer[Any]] | None: ...


@dataclass(frozen=True)
class WorldLengths:
    """A frame in which an object's lengths are world lengths.

    The linear part of the world matrix is a rotation (or reflection) of a symmetric stretch; points are
    stretched, not rotated, so orientation and accuracy do not depend on where the object stands.

    Attributes
    ----------
    stretch
        (3, 3) symmetric positive definite, or `None` where the object is not scaled.
    """

    stretch: NDArray[np.float64] | None

    @classmethod
    def of_matrix(cls, matrix: Any) -> WorldLengths:
        """Take the stretch of a 4 x 4 world matrix.

        Raises
        ------
        InputError
            When the matrix flattens the object.
        """
        linear = np.array(matrix, dtype=np.float64)[:3, :3]
        _, scales, axes = np.linalg.svd(linear)
        if not np.all(np.isfinite(scales)) or scales[-1] <= 1e-9 * scales[0]:
            raise InputError("The object's scale is zero along an axis.")
        if np.allclose(scales, 1.0, rtol=0.0, atol=1e-6):
            return cls(None)
        return cls(axes.T @ np.diag(scales) @ axes)

    def from_local(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Stretch local points (n, 3)."""
        return points if self.stretch is None else (points @ self.stretch).astype(np.float32)

    def to_local(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """Undo the stretch of points (n, 3)."""
        local = points if self.stretch is None else np.linalg.solve(self.stretch, np.asarray(points, float).T).T
        return np.ascontiguousarray(local, dtype=np.float32)


@dataclass(frozen=True)
class Source:
    """An object's mesh as it was when it was read.

    Attributes
    ----------
    name, session_uid
        Identify the object later; the name for messages, the number through renaming and undo.
    evaluated
        Whether the mesh is the one after modifiers and shape keys.
    arrays
        The mesh, its positions stretched to world lengths.
    lengths
        Leads from local positions to those of `arrays`.
    """

    name: str
    session_uid: int
    evaluated: bool
    arrays: MeshArrays
    lengths: WorldLengths


# Reading


def read_object(source: Object, depsgraph: Depsgraph, *, evaluated: bool = True, vertex_group: str = "") -> Source:
    """Copy an object's mesh into arrays.

    Parameters
    ----------
    evaluated
        Take the mesh after modifiers and shape keys, else the base mesh.
    vertex_group
        Group whose weights are the observation weights; a name that the object lacks means no weights.

    Raises
    ------
    InputError
        When the object is no mesh, or is flattened by its scale.
    """
    check_is_mesh(source)
    if source.mode == "EDIT":
        source.update_from_editmode()
    of = source.evaluated_get(depsgraph) if evaluated else source
    lengths = WorldLengths.of_matrix(source.evaluated_get(depsgraph).matrix_world)
    mesh = of.to_mesh(preserve_all_data_layers=True, depsgraph=depsgraph) if evaluated else of.to_mesh()
    try:
        arrays = read_mesh(mesh, lengths, _group_weights(source, mesh, vertex_group))
    finally:
        of.to_mesh_clear()
    return Source(source.name, source.session_uid, evaluated, arrays, lengths)


def check_is_mesh(source: Object) -> None:
    """Refuse what is no mesh object, in one sentence."""
    if source.type != "MESH":
        raise InputError(f"'{source.name}' is not a mesh; convert it to one first (Object > Convert > Mesh).")


def read_mesh(
    mesh: Mesh, lengths: WorldLengths | None = None, weights: NDArray[np.float32] | None = None
) -> MeshArrays:
    """Copy a mesh into arrays, its positions stretched by `lengths`."""
    vertices = read_positions(mesh)
    corners, sizes = read_polygons(mesh)
    triangles, triangle_polygons = read_triangles(mesh, corners, sizes)
    if lengths is not None:
        vertices = lengths.from_local(vertices)
    return MeshArrays(vertices, corners, sizes, triangles, triangle_polygons, weights)


def read_positions(mesh: Mesh) -> NDArray[np.float32]:
    """Return the local positions of a mesh's vertices, (V, 3)."""
    positions = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", positions)
    return positions.reshape(-1, 3)


def world_positions(placed: Object) -> NDArray[np.float64]:
    """Return the positions of an object's base mesh in the world, (V, 3)."""
    matrix = np.array(placed.matrix_world, dtype=np.float64)
    return read_positions(placed.data) @ matrix[:3, :3].T + matrix[:3, 3]


def read_polygons(mesh: Mesh) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the vertex of each polygon corner, (C,), and each polygon's number of corners, (F,)."""
    corners = np.empty(len(mesh.loops), dtype=np.int32)
    stored = mesh.attributes.get(".corner_vert")
    # Blender copies an attribute as it lies in memory, in a hundredth of the time; in Edit Mode it has none.
    if stored is not None and len(stored.data) == len(corners):
        stored.data.foreach_get("value", corners)
    else:
        mesh.loops.foreach_get("vertex_index", corners)
    sizes = np.empty(len(mesh.polygons), dtype=np.int32)
    mesh.polygons.foreach_get("loop_total", sizes)
    return corners, sizes


def read_triangles(
    mesh: Mesh, corners: NDArray[np.int32], sizes: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the triangles that Blender cuts the polygons into, (T, 3), and the polygon of each, (T,)."""
    if np.all(sizes == 3):  # nothing is cut, and Blender takes long to list the corners of triangles
        return corners.reshape(-1, 3), np.arange(len(sizes), dtype=np.int32)
    mesh.calc_loop_triangles()
    triangles = np.empty((len(mesh.loop_triangles), 3), dtype=np.int32)
    mesh.loop_triangles.foreach_get("vertices", triangles.ravel())
    polygons = np.empty(len(triangles), dtype=np.int32)
    mesh.loop_triangle_polygons.foreach_get("value", polygons)
    return triangles, polygons


def _group_weights(source: Object, mesh: Mesh, name: str) -> NDArray[np.float32] | None:
    group = source.vertex_groups.get(name) if name else None
    if group is None:
        return None
    index = group.index  # Blender has no `foreach_get` for vertex groups
    weights = [next((g.weight for g in vertex.groups if g.group == index), 0.0) for vertex in mesh.vertices]
    return np.array(weights, dtype=np.float32)


def find_object(session_uid: int) -> Object | None:
    """Return the object that a `Source` was read from, if it is still there."""
    return next((candidate for candidate in bpy.data.objects if candidate.session_uid == session_uid), None)


def same_topology(arrays: MeshArrays, mesh: Mesh) -> bool:
    """Whether a mesh still has the polygons that were read."""
    if len(mesh.vertices) != len(arrays.vertices) or len(mesh.polygons) != len(arrays.sizes):
        return False
    corners, sizes = read_polygons(mesh)
    return np.array_equal(sizes, arrays.sizes) and np.array_equal(corners, arrays.corners)


# Writing


def create_result(
    context: Context, source: Source, result: Result, scale: ColourScale, *, replace: bool = False
) -> Object:
    """Make the result object: a copy of the source's mesh with moved vertices, attributes and report.

    With `replace`, an earlier result of the same source gets the new mesh instead.

    Raises
    ------
    InputError
        When the source was removed or edited since it was read.
    """
    made_from, mesh = copy_source(source, context)
    name = mesh.name = result_name(made_from.name)
    set_positions(mesh, source.lengths.to_local(result.vertices))
    made = _take_over_earlier(name, mesh) if replace else None
    if made is None:
        made = bpy.data.objects.new(name, mesh)
        link_beside(made, made_from, context)
    place_like(made, made_from)
    _rename_groups(made)
    if result.history is not None:
        add_iteration_keys(made, np.stack([source.lengths.to_local(points) for points in result.history]))
    layers = {
        ERROR: result.error,
        ERROR_COLOUR: scale.colours(result.error),
        PATCH: result.patch,
        DOMAIN_STRETCH: result.domain_stretch,
    }
    write_layers(mesh, layers)
    if result.creases is not None:
        mark_sharp(mesh, result.creases)
    made[REPORT] = json.loads(json.dumps(result.report))  # plain values only, as Blender stores them
    store_representation(made, result.representation.stored, source.lengths)
    store_scale(made, scale)
    return made


def store_representation(made: Object, stored: bytes, lengths: WorldLengths) -> None:
    """Keep a saved representation with an object, and how the object's lengths relate to those of its points.

    In a custom property of the object Blender carries it through saving, undo, duplicating and appending, and copies it
    only when the object is evaluated anew; a property of the mesh would be copied whenever a vertex moves.
    """
    if REPRESENTATION in made:
        del made[REPRESENTATION]  # bytes assigned to a property that is there already end at their first zero
    made[REPRESENTATION] = stored
    if lengths.stretch is not None:
        made[STRETCH] = [float(value) for value in lengths.stretch.ravel()]
    elif STRETCH in made:
        del made[STRETCH]


def store_scale(coloured: Object, scale: ColourScale) -> None:
    """Note on an object how its errors are coloured, for the legend."""
    coloured[SCALE] = [scale.low, scale.high, scale.tolerance]


def copy_source(source: Source, context: Context) -> tuple[Object, Mesh]:
    """Return the object that was read, and a copy of its mesh to become the result's.

    Raises
    ------
    InputError
        When the object was removed or edited since it was read.
    """
    made_from = _remaining_source(source)
    return made_from, _copy_mesh(made_from, source, context)


def _remaining_source(source: Source) -> Object:
    found = find_object(source.session_uid)
    if found is None or found.type != "MESH":
        raise InputError(f"'{source.name}' was deleted while it was being approximated; its result is dropped.")
    if found.mode == "EDIT":
        found.update_from_editmode()
    return found


def _copy_mesh(made_from: Object, source: Source, context: Context) -> Mesh:
    """Copy the mesh with every layer; shape keys stay behind, they would move the vertices back."""
    if source.evaluated:
        depsgraph = context.evaluated_depsgraph_get()
        evaluated = made_from.evaluated_get(depsgraph)
        mesh = bpy.data.meshes.new_from_object(evaluated, preserve_all_data_layers=True, depsgraph=depsgraph)
    else:
        mesh = bpy.data.meshes.new_from_object(made_from)
    for index, slot in enumerate(made_from.material_slots[: len(mesh.materials)]):
        if slot.link == "OBJECT":
            mesh.materials[index] = slot.material
    if not same_topology(source.arrays, mesh):
        bpy.data.meshes.remove(mesh)
        raise InputError(f"'{made_from.name}' was edited while it was being approximated; its result is dropped.")
    return mesh


def create_mesh(
    name: str,
    positions: NDArray[np.floating[Any]],
    corners: NDArray[np.integer[Any]],
    sizes: NDArray[np.integer[Any]],
    loose_edges: NDArray[np.integer[Any]] | None = None,
) -> Mesh:
    """Make a mesh of local positions (V, 3), corners (L,), numbers of corners (F,), and more edges (E, 2)."""
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(positions))
    mesh.vertices.foreach_set("co", np.ascontiguousarray(positions, dtype=np.float32).ravel())
    if loose_edges is not None and len(loose_edges):
        mesh.edges.add(len(loose_edges))
        mesh.edges.foreach_set("vertices", np.ascontiguousarray(loose_edges, dtype=np.int32).ravel())
    if len(sizes):
        mesh.loops.add(len(corners))
        mesh.loops.foreach_set("vertex_index", np.ascontiguousarray(corners, dtype=np.int32))
        mesh.polygons.add(len(sizes))
        starts = np.cumsum(sizes) - sizes
        mesh.polygons.foreach_set("loop_start", np.ascontiguousarray(starts, dtype=np.int32))
    mesh.update(calc_edges=True, calc_edges_loose=True)
    return mesh


def set_positions(mesh: Mesh, positions: NDArray[np.float32]) -> None:
    """Move the vertices of a mesh to local positions (V, 3)."""
    mesh.vertices.foreach_set("co", np.ascontiguousarray(positions, dtype=np.float32).ravel())
    mesh.update()


def write_layers(mesh: Mesh, values: Mapping[str, NDArray[Any]]) -> None:
    """Write named layers of `_LAYERS`.

    All are made before any is filled: up to Blender 5.0 a handle goes stale when the next one is made.
    A layer of the user's that holds something else under the same name is kept under another.
    """
    for name in values:
        _make_layer(mesh, name)
    for name, array in values.items():
        kind, _, value = _LAYER[name]
        filled = np.ascontiguousarray(array, dtype=np.int32 if kind == "INT" else np.float32)
        mesh.attributes[name].data.foreach_set(value, filled.ravel())
    if ERROR_COLOUR in values:
        _show_colours(mesh)
    mesh.update()


def _make_layer(mesh: Mesh, name: str) -> None:
    kind, domain, _ = _LAYER[name]
    there = mesh.attributes.get(name)
    if there is not None and (there.data_type, there.domain) == (kind, domain):
        return
    if there is not None:
        there.name = _OTHER_NAME.format(name)
    mesh.attributes.new(name, kind, domain)
    if name not in mesh.attributes:
        raise InputError(f"A vertex group has the name '{name}', which the heat map needs; rename it first.")


def _show_colours(mesh: Mesh) -> None:
    index = mesh.color_attributes.find(ERROR_COLOUR)
    mesh.color_attributes.active_color_index = index
    mesh.color_attributes.render_color_index = index


def read_error(mesh: Mesh) -> NDArray[np.float32]:
    """Return the attribute `error` of a mesh, (V,)."""
    errors = np.empty(len(mesh.vertices), dtype=np.float32)
    mesh.attributes[ERROR].data.foreach_get("value", errors)
    return errors


def _take_over_earlier(name: str, mesh: Mesh) -> Object | None:
    """Put a mesh into the result object of this name, if there is one, and return that object."""
    earlier = bpy.data.objects.get(name)
    if earlier is None or earlier.type != "MESH" or REPORT not in earlier or earlier.library is not None:
        return None
    old, earlier.data = earlier.data, mesh
    if old.users == 0:
        bpy.data.meshes.remove(old)
    mesh.name = name
    return earlier


def _rename_groups(made: Object) -> None:
    """Leave the names of the result's layers to attributes: Blender allows no attribute of a vertex group's name."""
    for name in _LAYER:
        if name in made.vertex_groups:
            made.vertex_groups[name].name = _OTHER_NAME.format(name)


def link_beside(made: Object, beside: Object, context: Context) -> None:
    """Link an object into the collections of another, or the scene's where those are read-only, and its local views."""
    editable: list[Collection] = [c for c in beside.users_collection if c.is_editable]
    for collection in editable or [context.scene.collection]:
        collection.objects.link(made)
    join_local_views(made, beside, context)


def place_like(made: Object, model: Object) -> None:
    """Give an object the place of another in the world, and its parent, so that it follows the same moves."""
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


def write_error(coloured: Object, error: NDArray[np.floating], scale: ColourScale) -> None:
    """Write the errors (V,) of an object's vertices, their colours, and the scale for the legend."""
    write_layers(coloured.data, {ERROR: error, ERROR_COLOUR: scale.colours(error)})
    store_scale(coloured, scale)

"""The bridge between Blender's meshes and arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from bpy.types import Depsgraph, Mesh, Object
from numpy.typing import NDArray

from ...solver.errors import InputError
from ...solver.interchange import MeshArrays
from ...solver.mesh.quads import cut_quads
from .attributes import fetch, put, read_built_in, write_positions


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
    """An object's mesh at the time when it was read.

    Attributes
    ----------
    name, session_uid
        Identify the object later: the name in messages, the number in spite of renaming and undo.
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
        When the object is not a mesh, or its scale flattens it.
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
    """Refuse an object that is not a mesh.

    Raises
    ------
    InputError
        When it is not one.
    """
    if source.type != "MESH":
        raise InputError(f"'{source.name}' is not a mesh; convert it to one first (Object > Convert > Mesh).")


def read_mesh(
    mesh: Mesh, lengths: WorldLengths | None = None, weights: NDArray[np.float32] | None = None
) -> MeshArrays:
    """Copy a mesh into arrays, its positions stretched by `lengths`."""
    vertices = read_positions(mesh)
    corners, sizes = read_polygons(mesh)
    stretched = vertices if lengths is None else lengths.from_local(vertices)
    # Blender splits quads before they are stretched, which can change how it does that.
    later = stretched is vertices and not _has_larger_polygons(sizes)
    triangulation = None if later else read_triangles(mesh, vertices, corners, sizes)
    return MeshArrays(stretched, corners, sizes, triangulation, weights, _sharp_edges(mesh))


def _has_larger_polygons(sizes: NDArray[np.int32]) -> bool:
    return bool(sizes.size and (sizes.min() < 3 or sizes.max() > 4))


def read_positions(mesh: Mesh) -> NDArray[np.float32]:
    """Return the local positions of a mesh's vertices, (V, 3)."""
    return read_built_in(mesh, "position")


def to_world(placed: Object, local: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return the world positions of an object's local ones, (n, 3)."""
    matrix = np.array(placed.matrix_world, dtype=np.float64)
    return local @ matrix[:3, :3].T + matrix[:3, 3]


def read_polygons(mesh: Mesh) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the vertex of each polygon corner, (C,), and each polygon's number of corners, (F,)."""
    starts = fetch(mesh.polygons, "loop_start", np.int32)
    return read_built_in(mesh, ".corner_vert"), np.diff(starts, append=np.int32(len(mesh.loops)))


def vertex_areas(mesh: Mesh) -> NDArray[np.float64]:
    """Return the area of the faces around each vertex that is its own, (V,); 1 for each in a mesh of points."""
    if not len(mesh.polygons):
        return np.ones(len(mesh.vertices))
    corners, sizes = read_polygons(mesh)
    parts = np.repeat(fetch(mesh.polygons, "area") / np.maximum(sizes, 1), sizes)
    return np.bincount(corners, weights=parts, minlength=len(mesh.vertices)).astype(np.float64)


def read_triangles(
    mesh: Mesh, positions: NDArray[np.float32], corners: NDArray[np.int32], sizes: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the triangles that Blender cuts the polygons into, (T, 3), and the polygon of each, (T,)."""
    if not _has_larger_polygons(sizes):  # Blender takes twice as long to list the corners of its triangles
        return cut_quads(positions, corners, sizes)
    mesh.calc_loop_triangles()
    return fetch(mesh.loop_triangles, "vertices", np.int32, 3), fetch(mesh.loop_triangle_polygons, "value", np.int32)


def read_edges(mesh: Mesh) -> NDArray[np.int64]:
    """Return the vertices of a mesh's edges, (E, 2)."""
    return read_built_in(mesh, ".edge_verts").astype(np.int64)


def loose_edges(mesh: Mesh) -> NDArray[np.int64]:
    """Return the vertices of the edges that belong to no face, (E, 2)."""
    free = np.ones(len(mesh.edges), dtype=bool)
    free[read_built_in(mesh, ".corner_edge")] = False
    return read_edges(mesh)[free]


def sharp_turns(mesh: Mesh, degrees: float) -> int:
    """Return at how many edges two faces meet whose normals differ by more than an angle."""
    sizes = read_polygons(mesh)[1]
    edge = read_built_in(mesh, ".corner_edge")
    order = np.argsort(edge, kind="stable")
    normals = fetch(mesh.polygons, "normal", np.float32, 3)[np.repeat(np.arange(len(sizes)), sizes)[order]]
    beside = np.flatnonzero(edge[order][1:] == edge[order][:-1])
    turns = (normals[beside] * normals[beside + 1]).sum(axis=1) < np.cos(np.radians(degrees))
    return int(np.count_nonzero(turns))


def mark_sharp(mesh: Mesh, pairs: NDArray[np.integer[Any]]) -> None:
    """Mark the edges between pairs of vertices (E, 2) as sharp; pairs without an edge are ignored."""
    sharp = read_built_in(mesh, "sharp_edge")
    sharp |= np.isin(_pair_keys(read_edges(mesh), len(mesh.vertices)), _pair_keys(pairs, len(mesh.vertices)))
    put(mesh.edges, "use_edge_sharp", sharp, np.bool_)
    mesh.update()


def _sharp_edges(mesh: Mesh) -> NDArray[np.int32] | None:
    """Vertices of the edges that are marked as sharp, (n, 2); None where none is."""
    if "sharp_edge" not in mesh.attributes and not mesh.is_editmode:
        return None  # Blender keeps the attribute only where an edge is or was marked
    sharp = read_built_in(mesh, "sharp_edge")
    return read_built_in(mesh, ".edge_verts")[sharp] if sharp.any() else None


def _pair_keys(pairs: NDArray[np.integer[Any]], vertices: int) -> NDArray[np.int64]:
    """One number for each unordered pair."""
    low, high = np.sort(pairs.astype(np.int64), axis=1).T
    return low * vertices + high


def _group_weights(source: Object, mesh: Mesh, name: str) -> NDArray[np.float32] | None:
    group = source.vertex_groups.get(name) if name else None
    if group is None:
        return None
    index = group.index  # Blender has no `foreach_get` for vertex groups
    weights = [next((g.weight for g in vertex.groups if g.group == index), 0.0) for vertex in mesh.vertices]
    return np.array(weights, dtype=np.float32)


def same_topology(arrays: MeshArrays, mesh: Mesh) -> bool:
    """Whether a mesh still has the polygons that were read."""
    if len(mesh.vertices) != len(arrays.vertices) or len(mesh.polygons) != len(arrays.sizes):
        return False
    corners, sizes = read_polygons(mesh)
    return np.array_equal(sizes, arrays.sizes) and np.array_equal(corners, arrays.corners)


def create_mesh(
    name: str,
    positions: NDArray[np.floating[Any]],
    corners: NDArray[np.integer[Any]] | None = None,
    sizes: NDArray[np.integer[Any]] | None = None,
    loose_edges: NDArray[np.integer[Any]] | None = None,
) -> Mesh:
    """Make a mesh.

    Parameters
    ----------
    positions
        Local, (V, 3).
    corners, sizes
        Vertex of each polygon corner, (C,), and each polygon's number of corners, (F,); without them there are only
        points.
    loose_edges
        Vertices of edges that belong to no face, (E, 2).
    """
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(positions))
    write_positions(mesh, positions)
    if loose_edges is not None and len(loose_edges):
        mesh.edges.add(len(loose_edges))
        put(mesh.edges, "vertices", loose_edges, np.int32)
    if corners is not None and sizes is not None and len(sizes):
        mesh.loops.add(len(corners))
        put(mesh.loops, "vertex_index", corners, np.int32)
        mesh.polygons.add(len(sizes))
        put(mesh.polygons, "loop_start", np.cumsum(sizes) - sizes, np.int32)
    mesh.update(calc_edges=True, calc_edges_loose=True)
    return mesh


def triangle_mesh(name: str, positions: NDArray[np.floating[Any]], triangles: NDArray[np.integer[Any]]) -> Mesh:
    """Make a mesh of local positions (V, 3) and triangles (T, 3)."""
    return create_mesh(name, positions, triangles.ravel(), np.full(len(triangles), 3, dtype=np.int32))


def set_positions(mesh: Mesh, positions: NDArray[np.floating[Any]]) -> None:
    """Move the vertices of a mesh to local positions (V, 3)."""
    write_positions(mesh, positions)
    mesh.update()

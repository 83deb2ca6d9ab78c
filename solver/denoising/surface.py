"""What every step of denoising asks of a mesh: triangles in one orientation, their neighbours, their normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array

from ..arrays import Array, Indices
from ..mesh.triangle_mesh import TriangleMesh

_CROWD = 64  # corners around a vertex beyond which its triangles count as neighbours only across edges


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles of a mesh as denoising sees them.

    Attributes
    ----------
    triangles
        Vertices of the corners, (T, 3), consistently wound within each orientable component.
    neighbours
        Triangle across each side, (T, 3); -1 on open borders and on collapsed triangles.
    around
        Which triangles share a vertex, (T, T), without the triangle itself; the pattern counts, not the values.
    """

    triangles: Indices
    neighbours: Indices
    around: csr_array


def build_surface(mesh: TriangleMesh) -> Surface:
    """Return the triangles of `mesh` with their neighbours."""
    triangles = mesh.triangles.copy()
    turned = mesh.winding < 0
    triangles[turned] = triangles[turned, ::-1]
    both = mesh.edge_triangles[mesh.triangle_edges]
    across = both.sum(axis=2) - np.arange(len(triangles))[:, None]
    neighbours = np.where((both[..., 1] < 0) | mesh.collapsed[:, None], -1, across)
    return Surface(triangles, neighbours, _around(mesh, neighbours))


def _around(mesh: TriangleMesh, neighbours: Indices) -> csr_array:
    count = len(neighbours)
    crowded = np.diff(mesh.fan_offsets) > _CROWD
    corners = np.flatnonzero(~np.repeat(mesh.collapsed, 3) & ~crowded[mesh.nodes.ravel()])
    ones = np.ones(len(corners), dtype=np.int8)
    shape = (mesh.node_count, count)
    at_node = coo_array((ones, (mesh.nodes.ravel()[corners], corners // 3)), shape=shape).tocsr()
    triangle, side = np.nonzero(neighbours >= 0)
    ones = np.ones(len(triangle), dtype=np.int8)
    across = coo_array((ones, (triangle, neighbours[triangle, side])), shape=(count, count)).tocsr()
    around = coo_array(at_node.T @ at_node + across)
    apart = around.row != around.col
    ones = np.ones(int(apart.sum()), dtype=np.int8)
    return coo_array((ones, (around.row[apart], around.col[apart])), shape=(count, count)).tocsr()


def normals_and_areas(vertices: Array, triangles: Indices) -> tuple[Array, Array]:
    """Return the unit normals, (T, 3), zero where a triangle has no area, and the areas, (T,)."""
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    crossed = np.asarray(np.cross(b - a, c - a), dtype=np.float64)
    length = np.linalg.norm(crossed, axis=1)
    return unit(crossed), 0.5 * length


def vertex_normals(normals: Array, triangles: Indices, vertex_count: int) -> Array:
    """Return the direction of the sum of the triangles' (weighted) normals at each vertex, (V, 3); zero where none."""
    sums = [np.bincount(triangles.ravel(), np.repeat(normals[:, axis], 3), vertex_count) for axis in range(3)]
    return unit(np.stack(sums, axis=1))


def unit(vectors: Array) -> Array:
    """Return the vectors at length 1; those without a length stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)

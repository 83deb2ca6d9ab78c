"""The mesh as all steps of denoising use it: triangles in one orientation, and their neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array

from ..arrays import Booleans, Indices
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
    border
        Vertices on open borders and where surfaces meet, (V,).
    around
        Which triangles share a vertex, (T, T), without the triangle itself; the pattern counts, not the values.
    """

    triangles: Indices
    neighbours: Indices
    border: Booleans
    around: csr_array


def build_surface(mesh: TriangleMesh, cut: TriangleMesh | None = None) -> Surface:
    """Return the triangles of `mesh` with their neighbours.

    If a copy of the mesh that is cut along edges is given, triangles on two sides of a cut are not neighbours.
    """
    whole, mesh = mesh, mesh if cut is None else cut
    triangles = mesh.triangles.copy()
    turned = mesh.winding < 0
    triangles[turned] = triangles[turned, ::-1]
    both = mesh.edge_triangles[mesh.triangle_edges]
    across = both.sum(axis=2) - np.arange(len(triangles))[:, None]
    neighbours = np.where((both[..., 1] < 0) | mesh.collapsed[:, None], -1, across)
    border = np.zeros(len(whole.vertices), dtype=bool)
    border[whole.node_vertex[whole.border]] = True
    return Surface(triangles, neighbours, border, _around(mesh, neighbours))


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

"""The mesh as all steps of denoising use it: triangles in one orientation, and their neighbours."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from ..arrays import Booleans, Indices
from ..mesh.triangle_mesh import TriangleMesh, cut_along

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
    mesh
        The mesh, cut where triangles are not neighbours.
    """

    triangles: Indices
    neighbours: Indices
    border: Booleans
    around: csr_array
    mesh: TriangleMesh

    def cut_along(self, creases: Booleans) -> Surface:
        """Return the same triangles, which are not neighbours across some edges of `mesh`, (E,)."""
        cut = cut_along(self.mesh, creases)
        neighbours = _neighbours(cut)
        return replace(self, neighbours=neighbours, around=_around(cut, neighbours), mesh=cut)


def build_surface(mesh: TriangleMesh, cut: TriangleMesh | None = None) -> Surface:
    """Return the triangles of `mesh` with their neighbours.

    If a copy of the mesh that is cut along edges is given, triangles on two sides of a cut are not neighbours.
    """
    whole, mesh = mesh, mesh if cut is None else cut
    triangles = mesh.triangles.copy()
    turned = mesh.winding < 0
    triangles[turned] = triangles[turned, ::-1]
    neighbours = _neighbours(mesh)
    border = np.zeros(len(whole.vertices), dtype=bool)
    border[whole.node_vertex[whole.border]] = True
    return Surface(triangles, neighbours, border, _around(mesh, neighbours), mesh)


def _neighbours(mesh: TriangleMesh) -> Indices:
    both = mesh.edge_triangles[mesh.triangle_edges]
    across = both.sum(axis=2) - np.arange(len(mesh.triangles))[:, None]
    return np.where((both[..., 1] < 0) | mesh.collapsed[:, None], -1, across)


def _around(mesh: TriangleMesh, neighbours: Indices) -> csr_array:
    count = len(neighbours)
    sizes = np.diff(mesh.fan_offsets)
    crowded = sizes > _CROWD
    pairs = int((sizes[~crowded] ** 2).sum()) + 3 * count
    number = np.int32 if max(pairs, mesh.node_count) < 1 << 31 else np.int64  # most of the memory are numbers
    corners = np.flatnonzero(~np.repeat(mesh.collapsed, 3) & ~crowded[mesh.nodes.ravel()])
    at_node = _pattern(
        mesh.nodes.ravel()[corners].astype(number), (corners // 3).astype(number), mesh.node_count, count
    )
    del corners
    triangle, side = np.nonzero(neighbours >= 0)
    across = _pattern(triangle.astype(number), neighbours[triangle, side].astype(number), count, count)
    del triangle, side
    around = csr_array(csr_array(at_node.T) @ at_node) + across
    del at_node, across
    around.sort_indices()
    apart = around.indices != np.repeat(np.arange(count, dtype=number), np.diff(around.indptr))
    offsets = np.concatenate((np.zeros(1, number), np.cumsum(apart, dtype=number)))[around.indptr]
    columns = around.indices[apart]
    return csr_array((np.ones(len(columns), dtype=np.int8), columns, offsets), shape=(count, count))


def _pattern(rows: NDArray[np.integer[Any]], columns: NDArray[np.integer[Any]], height: int, width: int) -> csr_array:
    ones = np.ones(len(rows), dtype=np.int8)
    return csr_array(coo_array((ones, (rows, columns)), shape=(height, width)))

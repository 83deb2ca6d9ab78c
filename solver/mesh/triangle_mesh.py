"""Triangle meshes: triangulation of polygons, adjacency, components, borders, cuts where the mesh is not manifold.

All later modules work on *nodes* instead of vertices.  On a manifold mesh they are the same.  Where more
than two triangles meet at an edge, or several fans of triangles at a vertex ("bow tie"), the mesh is cut: each fan gets
its own node, so that every node has a single fan and no patch extends across a cut.  The vertices there are passed
through, which keeps the surface in one piece.

A mesh can also be cut along creases (`cut_along`).  Their vertices are not passed through: the sides of a crease are
fitted by themselves, and the surface is closed when it is evaluated (see `surface.closing`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array, csr_array

from ..arrays import Array, Booleans, Indices, any_of, extent_of, offsets_of, rows_at
from .edges import connected_parts, edge_keys, stable_order
from .input_checks import checked_faces, checked_triangulation, checked_vertices, refuse_without_area
from .pieces import Pieces
from .topology import join_sides, number_edges, split_into_fans, winding_of
from .triangulation import triangulate
from .welding import COINCIDENT


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A triangulated mesh with its topology.

    Attributes
    ----------
    vertices
        Positions, (V, 3), in scene units.
    triangles
        Vertices of each triangle's corners, (T, 3), as they were given.
    polygon
        Input face of each triangle, (T,).
    polygon_count
        Number of input faces; one that has no area may have no triangle.
    face_offsets, face_corners
        The input faces: face `f` has the vertices `face_corners[face_offsets[f]:face_offsets[f + 1]]`.
    nodes
        Node of each triangle corner, (T, 3).  Node `v` < V belongs to vertex `v`; further nodes are made by cuts.
    node_vertex
        Vertex of each node, (N,), N >= V.
    triangle_edges
        Edge between the corners 0-1, 1-2 and 2-0 of each triangle, (T, 3); -1 on collapsed triangles.
    edges
        Nodes of each edge, (E, 2).
    edge_triangles
        The triangles on both sides of each edge, (E, 2); the second is -1 on an open border.
    adjacency
        Which nodes share an edge, (N, N), symmetric, ones.
    fan_offsets, fan_triangles
        Triangles around node `n` are `fan_triangles[fan_offsets[n]:fan_offsets[n + 1]]`.
    component, component_count
        Connected component of each node, (N,).
    border
        Nodes on an open border, which includes the lips of a cut, (N,).
    winding
        (T,) 1 or -1: how to turn each triangle so that its component is oriented consistently; 0 where the component
        has no orientation (Moebius strip).
    collapsed
        Triangles that name a vertex twice, (T,).  They take no part in the topology.
    passed_through
        Vertices that keep their position whatever is fitted, (V,): those of cuts and of collapsed triangles, and
        those that no triangle uses.
    creases
        Edges along which the mesh is cut as pairs of vertices, (C, 2), the smaller number first, sorted.
    crowded
        Whether some edges have more than two triangles.
    """

    vertices: Array
    triangles: Indices
    polygon: Indices
    polygon_count: int
    face_offsets: Indices
    face_corners: Indices
    nodes: Indices
    node_vertex: Indices
    triangle_edges: Indices
    edges: Indices
    edge_triangles: Indices
    adjacency: csr_array
    fan_offsets: Indices
    fan_triangles: Indices
    component: Indices
    component_count: int
    border: Booleans
    winding: NDArray[np.int8]
    collapsed: Booleans
    passed_through: Booleans
    creases: Indices
    crowded: bool

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return len(self.node_vertex)

    @property
    def used(self) -> Booleans:
        """Nodes that belong to at least one triangle, (N,)."""
        return np.diff(self.fan_offsets) > 0

    @cached_property
    def reach(self) -> csr_array:
        """Which nodes are at most one edge apart, (N, N): a power of it spans rings."""
        own = csr_array((np.ones(self.node_count, dtype=bool), (np.arange(self.node_count),) * 2))
        return csr_array(self.adjacency.astype(bool) + own)

    @cached_property
    def incidence(self) -> csr_array:
        """Which triangles lie around which node, (N, T)."""
        ones = np.ones(len(self.fan_triangles), dtype=bool)
        shape = (self.node_count, len(self.triangles))
        return csr_array((ones, self.fan_triangles, self.fan_offsets), shape=shape)

    @cached_property
    def triangle_edge_incidence(self) -> csr_array:
        """Which edges belong to which triangle, (T, E)."""
        rows = np.flatnonzero(~self.collapsed)
        offsets = offsets_of(np.where(self.collapsed, 0, 3))
        ones = np.ones(3 * len(rows), dtype=bool)
        shape = (len(self.triangles), len(self.edges))
        return csr_array((ones, self.triangle_edges[rows].reshape(-1), offsets), shape=shape)

    @cached_property
    def border_loops(self) -> tuple[Indices, Indices]:
        """Open border that each edge lies on, (E,), -1 inside the surface, and the number of edges of each border."""
        on_border = np.flatnonzero(self.edge_triangles[:, 1] < 0)
        ends = self.edges[on_border]
        _, label = connected_parts(ends[:, 0], ends[:, 1], self.node_count)
        _, number, sides = np.unique(label[ends[:, 0]], return_inverse=True, return_counts=True)
        loop = np.full(len(self.edges), -1, dtype=np.int64)
        loop[on_border] = number
        return loop, sides

    @cached_property
    def twin_of_edge(self) -> Indices:
        """First edge between the same nodes for edges that are not alone between theirs, (E,); -1 for all others."""
        key = edge_keys(self.edges[:, 0], self.edges[:, 1], self.node_count)
        order = stable_order(key)
        same = np.diff(key[order], prepend=-1) == 0
        start = np.maximum.accumulate(np.where(same, 0, np.arange(len(key))))
        shared = same | np.append(same[1:], False)
        twin = np.full(len(key), -1)
        twin[order[shared]] = order[start[shared]]
        return twin

    @cached_property
    def named_by_vertices(self) -> Booleans:
        """Which edges are the only ones between their vertices, (E,): only these can be named by them."""
        one, other = self.node_vertex[self.edges[:, 0]], self.node_vertex[self.edges[:, 1]]
        key = edge_keys(one, other, len(self.vertices))
        order = stable_order(key)
        same = key[order[1:]] == key[order[:-1]]
        alone = np.ones(len(key), dtype=bool)
        alone[order[1:][same]] = alone[order[:-1][same]] = False
        return alone

    @cached_property
    def paired_sides(self) -> Indices:
        """The two sides, `3 t + i` from corner i of triangle t on, of each edge that has two triangles, (J, 2)."""
        sides = np.flatnonzero(self.triangle_edges.reshape(-1) >= 0)
        edge = self.triangle_edges.reshape(-1)[sides]
        paired = (self.edge_triangles[:, 1] >= 0)[edge]
        return sides[paired][stable_order(edge[paired])].reshape(-1, 2)

    @property
    def coincident_vertices(self) -> int:
        """Number of vertices on open borders at the place of another one, within `COINCIDENT` of the longest side."""
        on_border = self.vertices[np.unique(self.node_vertex[self.border])]
        cells = np.rint((on_border - self.vertices.min(axis=0)) / (COINCIDENT * self.longest_side or 1.0))
        _, first = np.unique(cells, axis=0, return_index=True)
        return len(on_border) - len(first)

    @cached_property
    def longest_side(self) -> float:
        """Longest side of the bounding box of all vertices."""
        return float(extent_of(self.vertices).max())

    @cached_property
    def pieces(self) -> Pieces:
        """Connected pieces, which cuts do not part; vertices that no triangle uses stand alone."""
        count = len(self.vertices)
        copies, own = self.component[count:], self.component[self.node_vertex[count:]]
        pieces, piece = connected_parts(copies, own, self.component_count)
        return Pieces.of(self.vertices, piece[self.component[:count]], pieces)

    @cached_property
    def triangle_pieces(self) -> Indices:
        """Piece of each triangle, (T,)."""
        return self.pieces.piece[self.triangles[:, 0]]

    @cached_property
    def piece_sizes(self) -> Array:
        """Longest side of the box around each triangle's piece, (T,)."""
        return self.pieces.sizes[self.triangle_pieces]


def build_mesh(
    vertices: ArrayLike,
    faces: ArrayLike | Sequence[Sequence[int]],
    triangles: tuple[ArrayLike, ArrayLike] | None = None,
) -> TriangleMesh:
    """Check the input and build its triangulation and topology.

    Parameters
    ----------
    vertices
        (V, 3) finite coordinates in scene units.
    faces
        (F, n) integer array, or a list of polygons of any length.
    triangles
        A known triangulation of the faces: corners (T, 3) and the face of each triangle (T,).

    Raises
    ------
    InputError
        When the mesh is empty, has no faces or no area, holds a coordinate that is not finite, or names a vertex that
        does not exist.
    """
    points = checked_vertices(vertices)
    corners, offsets = checked_faces(faces, len(points))
    if triangles is None:
        triples, polygon = triangulate(points, corners, offsets)
    else:
        triples, polygon = checked_triangulation(triangles, len(points), len(offsets) - 1)
    refuse_without_area(points, triples)
    return _with_topology(points, triples, polygon, offsets, corners)


def cut_along(mesh: TriangleMesh, edges: Booleans) -> TriangleMesh:
    """Cut a mesh along some of its edges that have two triangles, (E,).

    Each fan of triangles between creases gets a node of its own; the creases' sides are open borders then.  An edge by
    itself opens nothing and is left whole.
    """
    following = np.roll(mesh.triangles, -1, axis=1)
    sides, crease = mesh.paired_sides, edges[mesh.edge_triangles[:, 1] >= 0]
    split = (mesh.triangles, following, sides[~crease], ~mesh.collapsed, len(mesh.vertices))
    nodes, node_vertex = split_into_fans(*split)
    ends = np.stack([nodes.reshape(-1), np.roll(nodes, -1, axis=1).reshape(-1)], axis=1)
    ends = rows_at(ends, sides)
    opened = crease & (np.sort(ends[:, 0], axis=1) != np.sort(ends[:, 1], axis=1)).any(axis=1)
    kept = sides[~opened]
    found = _topology(mesh.vertices, mesh.triangles, nodes, node_vertex, kept, mesh.collapsed)
    cut = np.flatnonzero(mesh.edge_triangles[:, 1] >= 0)[opened]
    creases = np.unique(np.sort(mesh.node_vertex[mesh.edges[cut]], axis=1), axis=0)
    return replace(mesh, **found, creases=creases)


def _with_topology(
    points: Array, triangles: Indices, polygon: Indices, face_offsets: Indices, face_corners: Indices
) -> TriangleMesh:
    following = np.roll(triangles, -1, axis=1)
    collapsed = any_of(triangles == following)
    joined, crowded = join_sides(points, triangles, following, ~collapsed)
    nodes, node_vertex = split_into_fans(triangles, following, joined, ~collapsed, len(points))
    found = _topology(points, triangles, nodes, node_vertex, joined, collapsed)
    passed_through = np.diff(found["fan_offsets"])[: len(points)] == 0
    for passed in (node_vertex[len(points) :], crowded, triangles[collapsed]):
        passed_through[passed] = True
    return TriangleMesh(
        vertices=points,
        triangles=triangles,
        polygon=polygon,
        polygon_count=len(face_offsets) - 1,
        face_offsets=face_offsets,
        face_corners=face_corners,
        collapsed=collapsed,
        passed_through=passed_through,
        creases=np.zeros((0, 2), dtype=np.int64),
        crowded=len(crowded) > 0,
        **found,
    )


def _topology(
    points: Array, triangles: Indices, nodes: Indices, node_vertex: Indices, joined: Indices, collapsed: Booleans
) -> dict[str, Any]:
    """The fields of a mesh that follow from its nodes and from which sides are joined."""
    triangle_edges, edges, edge_triangles = number_edges(nodes, joined, ~collapsed)
    count = len(node_vertex)
    component_count, component = connected_parts(edges[:, 0], edges[:, 1], count)
    proper = np.flatnonzero(~collapsed)
    fan_corners = stable_order(nodes[proper].reshape(-1))
    border = np.zeros(count, dtype=bool)
    border[edges[edge_triangles[:, 1] < 0]] = True
    return {
        "nodes": nodes,
        "node_vertex": node_vertex,
        "triangle_edges": triangle_edges,
        "edges": edges,
        "edge_triangles": edge_triangles,
        "adjacency": _adjacency(edges, count),
        "fan_offsets": offsets_of(np.bincount(nodes[proper].reshape(-1), minlength=count)),
        "fan_triangles": proper[fan_corners // 3],
        "component": component,
        "component_count": component_count,
        "border": border,
        "winding": winding_of(points, triangles, joined),
    }


def _adjacency(edges: Indices, count: int) -> csr_array:
    one, other = np.ascontiguousarray(edges.T, dtype=np.int32 if count < 2**31 else np.int64)
    both = np.concatenate([one, other]), np.concatenate([other, one])
    adjacency = coo_array((np.ones(2 * len(one), dtype=np.int8), both), shape=(count, count)).tocsr()
    adjacency.data[:] = 1
    return adjacency

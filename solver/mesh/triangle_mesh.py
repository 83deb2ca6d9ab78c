"""Triangle meshes: triangulation of polygons, adjacency, components, borders, cuts where the mesh is no manifold.

Everything after this module works on *nodes* instead of vertices.  On a manifold mesh they are the same.  Where more
than two triangles meet at an edge, or several fans of triangles at a vertex ("bow tie"), the mesh is cut: each fan
gets a node of its own, so that every node has a single fan and no patch extends across a cut.  The vertices there are
passed through, which keeps the surface in one piece.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from ..arrays import Array, Booleans, Indices, offsets_of
from ..errors import InputError
from .triangulation import triangle_areas, triangulate

_MOST_PAIRED_TRIANGLES = 8  # an edge with more triangles than this is cut between all of them
_LARGEST_COORDINATE = 1e60  # squared areas still have to be finite


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
        links = coo_array((np.ones(len(ends), dtype=np.int8), (ends[:, 0], ends[:, 1])), shape=(self.node_count,) * 2)
        _, label = connected_components(links.tocsr(), directed=False)
        _, number, sides = np.unique(label[ends[:, 0]], return_inverse=True, return_counts=True)
        loop = np.full(len(self.edges), -1, dtype=np.int64)
        loop[on_border] = number
        return loop, sides

    @cached_property
    def twin_of_edge(self) -> Indices:
        """First edge between the same nodes for edges that are not alone between theirs, (E,); -1 for all others."""
        key = self.edges.min(axis=1) * np.int64(self.node_count) + self.edges.max(axis=1)
        _, first, number, count = np.unique(key, return_index=True, return_inverse=True, return_counts=True)
        return np.where(count[number] > 1, first[number], -1)

    @property
    def longest_side(self) -> float:
        """Longest side of the bounding box of all vertices."""
        return float(np.ptp(self.vertices, axis=0).max())


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
        A triangulation of the faces that is known already: corners (T, 3) and the face of each triangle (T,).

    Raises
    ------
    InputError
        When the mesh is empty, has no faces or no area, holds a coordinate that is not finite, or names a vertex that
        does not exist.
    """
    points = _checked_vertices(vertices)
    corners, offsets = _checked_faces(faces, len(points))
    if triangles is None:
        triples, polygon = triangulate(points, corners, offsets)
    else:
        triples, polygon = _checked_triangulation(triangles, len(points), len(offsets) - 1)
    _refuse_without_area(points, triples)
    return _with_topology(points, triples, polygon, offsets, corners)


# ---------------------------------------------------------------------------------------------------- checking input


def _checked_vertices(vertices: ArrayLike) -> Array:
    try:
        points = np.array(vertices, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("The vertices must be an array of three numbers each.") from None
    if points.size == 0:
        raise InputError("The mesh is empty: it has no vertices.")
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"The vertices must be an array of three numbers each, not of shape {points.shape}.")
    wrong = ~np.isfinite(points).all(axis=1)
    if wrong.any():
        raise InputError(f"Vertex {int(np.argmax(wrong))} has a coordinate that is not a finite number.")
    if np.abs(points).max() > _LARGEST_COORDINATE:
        raise InputError(f"The coordinates are too large to be computed with (beyond {_LARGEST_COORDINATE:g}).")
    return points


def _checked_faces(faces: ArrayLike | Sequence[Sequence[int]], vertex_count: int) -> tuple[Indices, Indices]:
    """Return the faces as one row of corners and offsets into it."""
    if isinstance(faces, np.ndarray) and faces.dtype != object:
        array = _checked_indices(faces, "faces")
        if array.ndim != 2 and array.size:
            raise InputError(f"The faces must be a list of polygons, not an array of shape {array.shape}.")
        sizes = np.full(len(array), array.shape[1] if array.ndim == 2 else 0, dtype=np.int64)
        corners = array.reshape(-1)
    else:
        try:
            polygons = [list(polygon) for polygon in cast(Iterable[Iterable[int]], faces)]
            joined = np.array(list(chain.from_iterable(polygons)))
        except (TypeError, ValueError):
            raise InputError("The faces must be a list of polygons, each a list of vertex numbers.") from None
        sizes = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
        corners = _checked_indices(joined, "faces")
    if len(sizes) == 0:
        raise InputError("The mesh has no faces.")
    if sizes.min() < 3:
        raise InputError(f"Face {int(np.argmin(sizes))} has fewer than three corners.")
    _refuse_out_of_range(corners, vertex_count)
    return corners, offsets_of(sizes)


def _checked_triangulation(
    triangles: tuple[ArrayLike, ArrayLike], vertex_count: int, face_count: int
) -> tuple[Indices, Indices]:
    try:
        triples, polygon = (_checked_indices(np.asarray(part), "triangles") for part in triangles)
    except ValueError as error:
        raise error if isinstance(error, InputError) else InputError("The triangles must be two arrays.") from None
    if triples.ndim != 2 or triples.shape[1:] != (3,) or polygon.shape != triples.shape[:1]:
        raise InputError("The triangles must be an array of three vertices each, and the face of each of them.")
    if len(triples) == 0:
        raise InputError("The mesh has no faces.")
    _refuse_out_of_range(triples, vertex_count)
    if polygon.min() < 0 or polygon.max() >= face_count:
        raise InputError(f"A triangle names a face that does not exist (there are {face_count}).")
    return triples, polygon


def _checked_indices(array: NDArray[np.generic], name: str) -> Indices:
    if array.size and not np.issubdtype(array.dtype, np.integer):
        raise InputError(f"The {name} must consist of whole numbers.")
    return array.astype(np.int64)


def _refuse_out_of_range(corners: Indices, vertex_count: int) -> None:
    low, high = int(corners.min()), int(corners.max())
    if low < 0 or high >= vertex_count:
        wrong = low if low < 0 else high
        raise InputError(f"A face names vertex {wrong}, but the vertices are numbered from 0 to {vertex_count - 1}.")


def _refuse_without_area(points: Array, triangles: Indices) -> None:
    used = points[triangles.reshape(-1)]
    side = float(np.ptp(used, axis=0).max()) if len(used) else 0.0
    if side < 1 / _LARGEST_COORDINATE or triangle_areas((points - used[0]) / side, triangles).sum() <= 1e-15:
        raise InputError("The mesh has no area: all of its faces are collapsed to lines or points.")


# ---------------------------------------------------------------------------------------------------------- topology


def _with_topology(
    points: Array, triangles: Indices, polygon: Indices, face_offsets: Indices, face_corners: Indices
) -> TriangleMesh:
    following = np.roll(triangles, -1, axis=1)
    collapsed = (triangles == following).any(axis=1)
    joined, crowded = _join_sides(points, triangles, following, ~collapsed)
    nodes, node_vertex = _split_into_fans(triangles, following, joined, ~collapsed, len(points))
    triangle_edges, edges, edge_triangles = _number_edges(nodes, joined, ~collapsed)
    count = len(node_vertex)
    both = np.concatenate((edges, edges[:, ::-1]))
    adjacency = coo_array((np.ones(len(both), dtype=np.int8), (both[:, 0], both[:, 1])), shape=(count, count)).tocsr()
    adjacency.data[:] = 1
    proper = np.flatnonzero(~collapsed)
    fan_corners = np.argsort(nodes[proper].reshape(-1), kind="stable")
    fan_sizes = np.bincount(nodes[proper].reshape(-1), minlength=count)
    component_count, component = connected_components(adjacency, directed=False)
    border = np.zeros(count, dtype=bool)
    border[edges[edge_triangles[:, 1] < 0]] = True
    passed_through = np.zeros(len(points), dtype=bool)
    passed_through[node_vertex[len(points) :]] = True
    passed_through[crowded] = True
    passed_through[triangles[collapsed]] = True
    passed_through[fan_sizes[: len(points)] == 0] = True
    return TriangleMesh(
        vertices=points,
        triangles=triangles,
        polygon=polygon,
        polygon_count=len(face_offsets) - 1,
        face_offsets=face_offsets,
        face_corners=face_corners,
        nodes=nodes,
        node_vertex=node_vertex,
        triangle_edges=triangle_edges,
        edges=edges,
        edge_triangles=edge_triangles,
        adjacency=adjacency,
        fan_offsets=offsets_of(fan_sizes),
        fan_triangles=proper[fan_corners // 3],
        component=component.astype(np.int64),
        component_count=int(component_count),
        border=border,
        winding=_solve_winding(points, triangles, joined),
        collapsed=collapsed,
        passed_through=passed_through,
    )


def _join_sides(points: Array, triangles: Indices, following: Indices, proper: Booleans) -> tuple[Indices, Indices]:
    """Pair the triangle sides that form an edge together.

    Side `3 t + i` of triangle t runs from its corner i to corner i + 1.  Returns the pairs of sides, (J, 2), and the
    vertices of edges with more than two triangles.
    """
    sides = np.flatnonzero(np.repeat(proper, 3))
    start, end = triangles.reshape(-1)[sides], following.reshape(-1)[sides]
    key = np.minimum(start, end) * np.int64(len(points)) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    sides, key = sides[order], key[order]
    first = np.flatnonzero(np.concatenate(([True], key[1:] != key[:-1]))) if len(key) else np.zeros(0, np.int64)
    count = np.diff(np.concatenate((first, [len(key)])))
    two = first[count == 2]
    joined = np.stack((sides[two], sides[two + 1]), axis=1)
    many = count > 2
    if not many.any():
        return joined, np.zeros(0, dtype=np.int64)
    crowded = np.concatenate((start[order][first[many]], end[order][first[many]]))
    paired = _pair_straightest(points, triangles, sides, first[many], count[many])
    return np.concatenate((joined, paired)), crowded


def _pair_straightest(points: Array, triangles: Indices, sides: Indices, first: Indices, count: Indices) -> Indices:
    """Join, at each edge with more than two triangles, those that continue each other best.

    A wall with a fin keeps its wall in one piece that way, and only the fin is cut off.
    """
    few = count <= _MOST_PAIRED_TRIANGLES
    found = []
    for size in np.unique(count[few]):
        rows = sides[first[count == size][:, None] + np.arange(size)]
        away = _directions_from_edge(points, triangles, rows)
        score = np.einsum("eix,ejx->eij", away, away)  # -1 where two triangles continue each other flatly
        score[:, np.arange(size), np.arange(size)] = np.inf
        each = np.arange(len(rows))
        for _ in range(int(size) // 2):
            one, two = np.divmod(score.reshape(len(rows), -1).argmin(axis=1), int(size))
            # Triangles that lie on top of each other bound no common surface.
            good = score[each, one, two] < 0.999
            found.append(np.stack((rows[each, one], rows[each, two]), axis=1)[good])
            for taken in (one, two):
                score[each, taken, :] = np.inf
                score[each, :, taken] = np.inf
    return np.concatenate(found) if found else np.zeros((0, 2), dtype=np.int64)


def _directions_from_edge(points: Array, triangles: Indices, sides: Indices) -> Array:
    """Return the unit vectors from each side into its triangle, perpendicular to the side."""
    triangle, corner = np.divmod(sides, 3)
    a, b, c = (points[triangles[triangle, (corner + i) % 3]] for i in range(3))
    along = _unit(b - a)
    inward = c - a
    return _unit(inward - (inward * along).sum(axis=-1, keepdims=True) * along)


def _unit(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def _split_into_fans(
    triangles: Indices, following: Indices, joined: Indices, proper: Booleans, vertex_count: int
) -> tuple[Indices, Indices]:
    """Give every fan of triangles around a vertex a node; return the nodes of corners and the vertices of nodes."""
    corner_count = triangles.size
    one, two = joined[:, 0], joined[:, 1]
    one_end, two_end = (3 * (side // 3) + (side % 3 + 1) % 3 for side in (one, two))
    opposed = triangles.reshape(-1)[one] == following.reshape(-1)[two]
    links = np.concatenate(
        (
            np.stack((one, np.where(opposed, two_end, two)), axis=1),
            np.stack((one_end, np.where(opposed, two, two_end)), axis=1),
        )
    )
    graph = coo_array((np.ones(len(links), dtype=np.int8), (links[:, 0], links[:, 1])), shape=(corner_count,) * 2)
    _, fan = connected_components(graph.tocsr(), directed=False)
    corners = np.flatnonzero(np.repeat(proper, 3))
    fans, first = np.unique(fan[corners], return_index=True)
    fan_vertex = triangles.reshape(-1)[corners[first]]
    order = np.lexsort((first, fan_vertex))
    extra = np.concatenate(([False], fan_vertex[order][1:] == fan_vertex[order][:-1]))
    node_of_fan = np.full(int(fan.max()) + 1, -1, dtype=np.int64)
    node_of_fan[fans] = fan_vertex
    node_of_fan[fans[order[extra]]] = vertex_count + np.arange(int(extra.sum()))
    nodes = triangles.copy().reshape(-1)
    nodes[corners] = node_of_fan[fan[corners]]
    node_vertex = np.concatenate((np.arange(vertex_count), fan_vertex[order[extra]]))
    return nodes.reshape(-1, 3), node_vertex


def _number_edges(nodes: Indices, joined: Indices, proper: Booleans) -> tuple[Indices, Indices, Indices]:
    """Return the edges of each triangle, the nodes of each edge and the triangles of each edge."""
    leader = np.arange(nodes.size)
    leader[joined.max(axis=1)] = joined.min(axis=1)
    sides = np.flatnonzero(np.repeat(proper, 3))
    leading = sides[leader[sides] == sides]
    number = np.full(nodes.size, -1, dtype=np.int64)
    number[leading] = np.arange(len(leading))
    side_edge = np.full(nodes.size, -1, dtype=np.int64)
    side_edge[sides] = number[leader[sides]]
    edges = np.stack((nodes.reshape(-1)[leading], np.roll(nodes, -1, axis=1).reshape(-1)[leading]), axis=1)
    edge_triangles = np.full((len(leading), 2), -1, dtype=np.int64)
    edge_triangles[:, 0] = leading // 3
    edge_triangles[number[joined.min(axis=1)], 1] = joined.max(axis=1) // 3
    return side_edge.reshape(-1, 3), edges, edge_triangles


def solve_winding(count: int, pairs: Indices, agree: Booleans, areas: Array) -> NDArray[np.int8]:
    """Orient triangles consistently.

    Every triangle stands for two, itself and its reverse; what can be reached over edges without a change of side
    belongs together (orientation double cover).

    Parameters
    ----------
    count
        Number of triangles.
    pairs
        Triangles that share an edge, (J, 2).
    agree
        Whether both run along the edge in opposite directions, (J,).
    areas
        Area of each triangle; the orientation that the greater area has already is kept.

    Returns
    -------
    (count,) 1: as it is, -1: reverse, 0: the triangle's component has no orientation.
    """
    winding = np.ones(count, dtype=np.int8)
    if agree.all():
        return winding
    one = np.concatenate((pairs[:, 0], pairs[:, 0] + count))
    two = np.concatenate((pairs[:, 1] + np.where(agree, 0, count), pairs[:, 1] + np.where(agree, count, 0)))
    graph = coo_array((np.ones(len(one), dtype=np.int8), (one, two)), shape=(2 * count, 2 * count)).tocsr()
    _, label = connected_components(graph, directed=False)
    kept, reversed_ = label[:count], label[count:]
    area = np.bincount(kept, weights=areas, minlength=int(label.max()) + 1)
    winding[area[reversed_] > area[kept]] = -1
    # Where both sides weigh the same, the one that holds the first triangle wins.
    tie = (area[reversed_] == area[kept]) & (reversed_ < kept)
    winding[tie] = -1
    winding[kept == reversed_] = 0
    return winding


def _solve_winding(points: Array, triangles: Indices, joined: Indices) -> NDArray[np.int8]:
    start = triangles.reshape(-1)
    agree = start[joined[:, 0]] != start[joined[:, 1]]
    return solve_winding(len(triangles), joined // 3, agree, triangle_areas(points, triangles))

"""Fewer triangles for the same shape: edges collapse where the quadric error is smallest (Garland, Heckbert 1997).

Many edges collapse at a time, no two of which touch a common triangle: each round is a few array operations.  No
collapse changes the topology, turns a triangle over, or leaves a vertex with fewer than three neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..arrays import Array, Booleans, Indices
from .edges import edge_keys
from .normals import area_vectors, unit

BORDER = 2.0
"""Weight of the planes that hold a border in place, beside those of the triangles."""

EVEN = 3e-3
"""Weight of an edge's squared length beside its quadric: flat places get triangles of even size."""

PULL = 1e-3
"""Weight that keeps a new vertex near the middle of its edge where the planes leave it free."""

LEAST_TURN = 0.2
"""Cosine of the largest angle by which a collapse may turn a triangle."""

LEAST_SHAPE = 0.2
"""A collapse makes no triangle worse than this, of 1 for an equilateral one, unless it was worse before."""

CHEAPEST = 0.4
"""Share of the edges, those with the smallest error, that may collapse in one round."""

PASSES = 4
"""Times that a round looks for further edges that touch none of those already chosen."""

FEWEST_NEIGHBOURS = 3


def decimated(vertices: Array, triangles: Indices, count: int) -> tuple[Array, Indices]:
    """Collapse edges of a manifold until `count` vertices are left, or none may collapse.

    Parameters
    ----------
    vertices, triangles
        (V, 3) and (T, 3); every vertex belongs to a triangle.
    """
    quadrics = _quadrics(vertices, triangles)
    state = np.arange(len(vertices))  # changes whenever something around a vertex does
    states = len(vertices)
    refused = np.zeros((0, 2), dtype=np.int64)
    while len(vertices) > count:
        edges = _Edges.of(triangles, len(vertices))
        place, cost = _places(vertices, quadrics, edges)
        pairs = state[edges.ends]
        open_ = ~np.isin(pairs[:, 0] << 32 | pairs[:, 1], refused[:, 0] << 32 | refused[:, 1])
        chosen, failed = _chosen(vertices, triangles, edges, place, cost, open_)
        refused = np.concatenate([refused, pairs[failed]])
        chosen = chosen[np.argsort(cost[chosen], kind="stable")][: len(vertices) - count]
        if not (len(chosen) or len(failed)):
            break
        near = np.zeros(len(vertices), dtype=bool)
        near[edges.ends[chosen]] = True
        near |= (edges.neighbours @ near.astype(np.int32)) > 0
        state = np.where(near, states + np.arange(len(vertices)), state)
        states += len(vertices)
        kept = np.ones(len(vertices), dtype=bool)
        kept[edges.ends[chosen, 1]] = False
        vertices, triangles, quadrics = _collapsed(vertices, triangles, quadrics, edges.ends[chosen], place[chosen])
        state = state[kept]
    return vertices, triangles


@dataclass(frozen=True)
class _Edges:
    """The edges of a mesh.

    Attributes
    ----------
    ends, opposite
        Vertices of each edge, and those opposite to it, -1 where a border has none, (E, 2).
    on_border, degree
        Whether a vertex lies on a border, and how many neighbours it has, (V,).
    neighbours
        1 where two vertices share an edge, (V, V).
    """

    ends: Indices
    opposite: Indices
    on_border: Booleans
    degree: Indices
    neighbours: sp.csr_matrix

    @classmethod
    def of(cls, triangles: Indices, count: int) -> _Edges:
        sides = edge_keys(triangles, np.roll(triangles, -1, axis=1), count).ravel()
        tips = np.roll(triangles, -2, axis=1).ravel()
        keys, first, edge = np.unique(sides, return_index=True, return_inverse=True)
        second = np.ones(len(sides), dtype=bool)
        second[first] = False
        opposite = np.full((len(keys), 2), -1)
        opposite[:, 0] = tips[first]
        opposite[edge[second], 1] = tips[second]
        ends = np.stack(np.divmod(keys, count), axis=1)
        on_border = np.zeros(count, dtype=bool)
        on_border[ends[opposite[:, 1] < 0]] = True
        both = np.concatenate([ends, ends[:, ::-1]])
        neighbours = sp.csr_matrix((np.ones(len(both), dtype=np.int32), both.T), shape=(count, count))
        return cls(ends, opposite, on_border, np.diff(neighbours.indptr).astype(np.int64), neighbours)

    def collapsible(self, asked: Indices) -> Booleans:
        """Which of some edges, no two of which touch a common triangle, leave a manifold of the same topology."""
        one, other = self.ends[asked].T
        opposite = self.opposite[asked]
        inner = opposite[:, 1] >= 0
        common = np.asarray(self.neighbours[one].multiply(self.neighbours[other]).sum(axis=1)).ravel()
        fits = common == np.where(inner, 2, 1)
        fits &= ~(inner & self.on_border[one] & self.on_border[other])
        fits &= self.degree[one] + self.degree[other] - 2 - common >= FEWEST_NEIGHBOURS
        # a vertex opposite to several of the edges loses a neighbour to each: the first ones may have it
        facing = opposite.ravel()
        order = np.argsort(facing, kind="stable")
        place = np.arange(len(facing)) - np.searchsorted(facing[order], facing[order])
        lost = np.empty_like(place)
        lost[order] = place + 1
        left = np.where(facing < 0, FEWEST_NEIGHBOURS, self.degree[facing] - lost)
        return np.asarray(fits & (left.reshape(-1, 2) >= FEWEST_NEIGHBOURS).all(axis=1))


def _quadrics(vertices: Array, triangles: Indices) -> Array:
    """Quadrics of each vertex, (V, 14): matrix (9), vector (3), constant, and the area that they stand for."""
    count = len(vertices)
    areas = area_vectors(vertices, triangles)
    normals, size = unit(areas), 0.5 * np.linalg.norm(areas, axis=1)
    edges = _Edges.of(triangles, count)
    open_ones = edges.ends[edges.opposite[:, 1] < 0]
    side_keys = edge_keys(triangles, np.roll(triangles, -1, axis=1), count).ravel()
    side = np.flatnonzero(np.isin(side_keys, edge_keys(open_ones[:, 0], open_ones[:, 1], count)))
    face = side // 3
    start, end = triangles.ravel()[side], np.roll(triangles, -1, axis=1).ravel()[side]
    along = vertices[end] - vertices[start]
    across = unit(np.asarray(np.cross(along, normals[face]), dtype=np.float64))
    planes = _planes(normals, vertices[triangles[:, 0]], size)
    borders = _planes(across, vertices[start], BORDER * (along**2).sum(axis=1))
    borders[:, 13] = 0.0
    rows = np.concatenate([triangles.T.ravel(), start, end])
    columns = np.concatenate([np.tile(np.arange(len(triangles)), 3), np.tile(np.arange(len(side)), 2) + len(triangles)])
    columns[3 * len(triangles) + len(side) :] = columns[3 * len(triangles) : 3 * len(triangles) + len(side)]
    sums = sp.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, len(triangles) + len(side)))
    return np.asarray(sums @ np.concatenate([planes, borders]))


def _planes(normals: Array, through: Array, weights: Array) -> Array:
    height = (normals * through).sum(axis=1)
    terms = [
        (normals[:, :, None] * normals[:, None]).reshape(-1, 9),
        height[:, None] * normals,
        height[:, None] ** 2,
        np.ones((len(normals), 1)),
    ]
    planes: Array = weights[:, None] * np.concatenate(terms, axis=1)
    return planes


def _places(vertices: Array, quadrics: Array, edges: _Edges) -> tuple[Array, Array]:
    """Where each edge would collapse to, (E, 3), and the error that this makes, (E,)."""
    one, other = edges.ends.T
    sums = quadrics[one] + quadrics[other]
    matrix, vector = sums[:, :9].reshape(-1, 3, 3), sums[:, 9:12]
    middle = 0.5 * (vertices[one] + vertices[other])
    held = edges.on_border[edges.ends]
    middle = np.where((held[:, 0] & ~held[:, 1])[:, None], vertices[one], middle)
    middle = np.where((held[:, 1] & ~held[:, 0])[:, None], vertices[other], middle)
    pull = PULL * sums[:, 13] + 1e-300
    place = (
        middle
        + np.linalg.solve(
            matrix + pull[:, None, None] * np.eye(3),
            (vector - np.matmul(matrix, middle[:, :, None])[:, :, 0])[:, :, None],
        )[:, :, 0]
    )
    length = _squared(vertices[one] - vertices[other])
    far = _squared(place - middle) > length
    place = np.where((far | (held[:, 0] != held[:, 1]))[:, None], middle, place)
    error = np.einsum("ei,ei->e", place, np.matmul(matrix, place[:, :, None])[:, :, 0] - 2.0 * vector) + sums[:, 12]
    return place, error + EVEN * sums[:, 13] * length


def _chosen(
    vertices: Array, triangles: Indices, edges: _Edges, place: Array, cost: Array, open_: Booleans
) -> tuple[Indices, Indices]:
    """Numbers of edges that may collapse at the same time, and of edges that may not collapse."""
    able = np.flatnonzero(open_)
    if not len(able):
        return able, able
    cheap = able[np.argsort(cost[able], kind="stable")[: max(int(CHEAPEST * len(able)), 1)]]
    rank = np.full(len(cost), len(cost))
    rank[cheap] = np.arange(len(cheap))
    active = open_ & (rank < len(cost))
    one, other = edges.ends.T
    found, failed = [cheap[:0]], [cheap[:0]]
    for _ in range(PASSES):
        smallest = _smallest_around(edges, np.where(active, rank, len(rank)))
        chosen = cheap[active[cheap] & (smallest[one[cheap]] == rank[cheap]) & (smallest[other[cheap]] == rank[cheap])]
        if not len(chosen):
            break
        active[chosen] = False
        good = edges.collapsible(chosen)
        good &= _keeps_shape(vertices, triangles, edges.ends[chosen], place[chosen])
        failed.append(chosen[~good])
        chosen = chosen[good]
        found.append(chosen)
        taken = np.zeros(len(vertices), dtype=np.int32)
        taken[edges.ends[chosen]] = 1
        taken += edges.neighbours @ taken
        # vertices opposite to a chosen edge have lost a neighbour: nothing around them collapses in this round
        taken[edges.opposite[chosen].clip(0)] = 1
        taken += edges.neighbours @ (taken > 0).astype(np.int32)
        active &= (taken[one] == 0) & (taken[other] == 0)
    return np.concatenate(found), np.concatenate(failed)


def _smallest_around(edges: _Edges, rank: Indices) -> Indices:
    """Smallest rank of the edges at each vertex and at its neighbours, (V,)."""
    smallest = np.full(len(edges.degree), np.iinfo(np.int64).max)
    one, other = edges.ends.T
    np.minimum.at(smallest, one, rank)
    np.minimum.at(smallest, other, rank)
    around = smallest.copy()
    np.minimum.at(around, one, smallest[other])
    np.minimum.at(around, other, smallest[one])
    return around


def _keeps_shape(vertices: Array, triangles: Indices, ends: Indices, place: Array) -> Booleans:
    """Which of some collapses turn no triangle over and make none a sliver, (C,)."""
    collapse = np.full(len(vertices), -1)
    collapse[ends] = np.arange(len(ends))[:, None]
    corner = collapse[triangles]
    moves = corner >= 0
    touched = np.flatnonzero(moves[:, 0].astype(np.int8) + moves[:, 1] + moves[:, 2] == 1)
    moved = vertices.copy()
    moved[ends] = place[:, None]
    before, after = (area_vectors(each, triangles[touched]) for each in (vertices, moved))
    turned = np.einsum("ti,ti->t", unit(before), unit(after)) < LEAST_TURN
    least = np.minimum(LEAST_SHAPE, triangle_shapes(vertices, triangles[touched]))
    worse = triangle_shapes(moved, triangles[touched]) < least
    good = np.ones(len(ends), dtype=bool)
    good[corner[touched[turned | worse]].max(axis=1)] = False
    return good


def triangle_shapes(vertices: Array, triangles: Indices) -> Array:
    """Return each triangle's area over that of an equilateral one with sides as long in the mean square, (T,)."""
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    squares = _squared(b - a) + _squared(c - b) + _squared(a - c)
    areas = np.sqrt(_squared(area_vectors(vertices, triangles)))
    shape: Array = 2.0 * np.sqrt(3.0) * areas / np.maximum(squares, 1e-300)
    return shape


def _collapsed(
    vertices: Array, triangles: Indices, quadrics: Array, ends: Indices, place: Array
) -> tuple[Array, Indices, Array]:
    kept, gone = ends.T
    vertices, quadrics = vertices.copy(), quadrics.copy()
    vertices[kept] = place
    quadrics[kept] += quadrics[gone]
    number = np.arange(len(vertices))
    number[gone] = kept
    triangles = number[triangles]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    left = np.ones(len(vertices), dtype=bool)
    left[gone] = False
    return vertices[left], (np.cumsum(left) - 1)[triangles], quadrics[left]


def _squared(vectors: Array) -> Array:
    return np.asarray(np.einsum("ni,ni->n", vectors, vectors))

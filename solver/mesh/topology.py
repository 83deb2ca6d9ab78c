"""The topology of triangles: which sides form an edge, where a mesh is cut, how its triangles are turned."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Booleans, Indices, any_of, folded
from .edges import connected_parts, edge_keys, stable_order
from .normals import triangle_areas, unit

_MOST_PAIRED_TRIANGLES = 8  # an edge with more triangles than this is cut between all of them

SAME_DIRECTION = 1.0
"""What a pair of sides that run in the same direction has to continue each other better by, as a cosine."""


def join_sides(points: Array, triangles: Indices, following: Indices, proper: Booleans) -> tuple[Indices, Indices]:
    """Pair the triangle sides that form an edge together.

    Side `3 t + i` of triangle t runs from its corner i to corner i + 1.  Returns the pairs of sides, (J, 2), and the
    vertices of edges with more than two triangles.
    """
    sides, first, count = _sides_by_edge(triangles, following, proper, len(points))
    two = first[count == 2]
    joined = np.stack((sides[two], sides[two + 1]), axis=1)
    many = count > 2
    if not many.any():
        return joined, np.zeros(0, dtype=np.int64)
    crowded = np.concatenate([ends.reshape(-1)[sides[first[many]]] for ends in (triangles, following)])
    paired = pair_straightest(points, triangles, sides, first[many], count[many])
    return np.concatenate((joined, paired)), crowded


def _sides_by_edge(
    triangles: Indices, following: Indices, proper: Booleans, vertex_count: int
) -> tuple[Indices, Indices, Indices]:
    """Sides sorted by the edge that they run along, where each edge's begin, (E,), and how many it has, (E,)."""
    key = edge_keys(triangles.reshape(-1), following.reshape(-1), vertex_count)
    sides: Indices | None = None
    if not proper.all():
        sides = np.flatnonzero(np.repeat(proper, 3))
        key = key[sides]
    order = stable_order(key)
    sides, key = order if sides is None else sides[order], key.take(order)
    first = np.flatnonzero(np.concatenate(([True], key[1:] != key[:-1]))) if len(key) else np.zeros(0, np.int64)
    return sides, first, np.diff(np.concatenate((first, [len(key)])))


def fans_between_creases(triangles: Indices, creases: Indices, vertex_count: int) -> tuple[Indices, Indices, Indices]:
    """Give every fan of triangles between creases, pairs of vertices (C, 2), a node.

    Returns
    -------
    nodes, node_vertex
        As `split_into_fans` returns them.
    sides
        The two sides of each crease, (C, 2); creases between other than two triangles are left out.
    """
    following = np.roll(triangles, -1, axis=1)
    proper = ~any_of(triangles == following)
    sides, first, count = _sides_by_edge(triangles, following, proper, vertex_count)
    two = first[count == 2]
    pairs = np.stack((sides[two], sides[two + 1]), axis=1)
    starts, ends = (own.reshape(-1).take(sides[two]) for own in (triangles, following))
    key = edge_keys(starts, ends, vertex_count)
    cut = np.isin(key, edge_keys(creases[:, 0], creases[:, 1], vertex_count))
    nodes, node_vertex = split_into_fans(triangles, following, pairs[~cut], proper, vertex_count)
    return nodes, node_vertex, pairs[cut]


def pair_straightest(
    points: Array,
    triangles: Indices,
    sides: Indices,
    first: Indices,
    count: Indices,
    forward: Booleans | None = None,
) -> Indices:
    """Join, at each edge with several triangles, those that continue each other best.

    A wall with a fin keeps its wall in one piece that way, and only the fin is cut off.  Where `forward` says in which
    direction each side runs, opposite ones are preferred: of two sheets on top of each other each continues itself.
    """
    few = count <= _MOST_PAIRED_TRIANGLES
    found = []
    for size in np.unique(count[few]):
        rows = sides[first[count == size][:, None] + np.arange(size)]
        away = _directions_from_edge(points, triangles, rows)
        score = np.einsum("eix,ejx->eij", away, away)  # -1 where two triangles continue each other flatly
        if forward is not None:
            along = forward[first[count == size][:, None] + np.arange(size)]
            score += np.where(along[:, :, None] == along[:, None, :], SAME_DIRECTION, 0.0)
        score[:, np.arange(size), np.arange(size)] = np.inf
        each = np.arange(len(rows))
        for _ in range(int(size) // 2):
            one, two = np.divmod(score.reshape(len(rows), -1).argmin(axis=1), int(size))
            # Triangles that lie on top of each other bound no common surface.
            good = (away[each, one] * away[each, two]).sum(axis=-1) < 0.999
            good &= np.isfinite(score[each, one, two])
            found.append(np.stack((rows[each, one], rows[each, two]), axis=1)[good])
            for taken in (one, two):
                score[each, taken, :] = np.inf
                score[each, :, taken] = np.inf
    return np.concatenate(found) if found else np.zeros((0, 2), dtype=np.int64)


def _directions_from_edge(points: Array, triangles: Indices, sides: Indices) -> Array:
    """Return the unit vectors from each side into its triangle, perpendicular to the side."""
    triangle, corner = np.divmod(sides, 3)
    a, b, c = (points[triangles[triangle, (corner + i) % 3]] for i in range(3))
    along = unit(b - a)
    inward = c - a
    return unit(inward - (inward * along).sum(axis=-1, keepdims=True) * along)


def split_into_fans(
    triangles: Indices, following: Indices, joined: Indices, proper: Booleans, vertex_count: int
) -> tuple[Indices, Indices]:
    """Give every fan of triangles around a vertex a node; return the nodes of corners and the vertices of nodes."""
    one, two = np.ascontiguousarray(joined.T)
    one_end, two_end = (np.where(side % 3 == 2, side - 2, side + 1) for side in (one, two))
    opposed = triangles.reshape(-1).take(one) == following.reshape(-1).take(two)
    other = np.where(opposed, two_end, two), np.where(opposed, two, two_end)
    _, fan = connected_parts(np.concatenate((one, one_end)), np.concatenate(other), triangles.size)
    vertex: Indices = triangles.reshape(-1)
    corners: Indices | slice = slice(None)
    if not proper.all():
        corners = np.flatnonzero(np.repeat(proper, 3))
        vertex, fan = vertex[corners], fan[corners]
    # parts are numbered by their lowest corners, so a fan's number says which of a vertex's comes first
    node_of_fan = np.full(triangles.size, -1, dtype=np.int64)
    node_of_fan[fan] = vertex
    fans = np.flatnonzero(node_of_fan >= 0)
    first_fan = np.full(vertex_count, -1, dtype=np.int64)
    first_fan[node_of_fan[fans[::-1]]] = fans[::-1]
    extra = fans[first_fan[node_of_fan[fans]] != fans]
    extra = extra[np.argsort(node_of_fan[extra], kind="stable")]
    node_vertex = np.concatenate((np.arange(vertex_count), node_of_fan[extra]))
    node_of_fan[extra] = vertex_count + np.arange(len(extra))
    nodes = triangles.copy().reshape(-1)
    nodes[corners] = node_of_fan.take(fan)
    return nodes.reshape(-1, 3), node_vertex


def mean_over_nodes(values: Array, node_vertex: Indices, vertices: int) -> Array:
    """Mean over the nodes of each vertex, (V, 3), of values at the nodes, (N, 3), of which the first V are vertices."""
    if len(node_vertex) == vertices:
        return values
    first = values[:vertices]
    # from the first node's value on, so that equal ones are kept to the last bit
    away = values - first[node_vertex]
    sums = [np.bincount(node_vertex, weights=column, minlength=vertices) for column in away.T]
    mean: Array = first + np.stack(sums, axis=1) / np.bincount(node_vertex, minlength=vertices)[:, None]
    return mean


def number_edges(nodes: Indices, joined: Indices, proper: Booleans) -> tuple[Indices, Indices, Indices]:
    """Return the edges of each triangle, the nodes of each edge and the triangles of each edge."""
    leader = np.arange(nodes.size)
    low, high = folded(np.minimum, joined), folded(np.maximum, joined)
    leader[high] = low
    sides = np.flatnonzero(np.repeat(proper, 3))
    leading = sides[leader[sides] == sides]
    number = np.full(nodes.size, -1, dtype=np.int64)
    number[leading] = np.arange(len(leading))
    side_edge = np.full(nodes.size, -1, dtype=np.int64)
    side_edge[sides] = number[leader[sides]]
    edges = np.stack((nodes.reshape(-1)[leading], np.roll(nodes, -1, axis=1).reshape(-1)[leading]), axis=1)
    edge_triangles = np.full((len(leading), 2), -1, dtype=np.int64)
    edge_triangles[:, 0] = leading // 3
    edge_triangles[number[low], 1] = high // 3
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
    (count,) 1: keep, -1: reverse, 0: the triangle's component has no orientation.
    """
    winding = np.ones(count, dtype=np.int8)
    if agree.all():
        return winding
    one = np.concatenate((pairs[:, 0], pairs[:, 0] + count))
    two = np.concatenate((pairs[:, 1] + np.where(agree, 0, count), pairs[:, 1] + np.where(agree, count, 0)))
    _, label = connected_parts(one, two, 2 * count)
    kept, reversed_ = label[:count], label[count:]
    area = np.bincount(kept, weights=areas, minlength=int(label.max()) + 1)
    winding[area[reversed_] > area[kept]] = -1
    # Where both sides weigh the same, the one that holds the first triangle wins.
    tie = (area[reversed_] == area[kept]) & (reversed_ < kept)
    winding[tie] = -1
    winding[kept == reversed_] = 0
    return winding


def winding_of(points: Array, triangles: Indices, joined: Indices) -> NDArray[np.int8]:
    start = triangles.reshape(-1)
    agree = start[joined[:, 0]] != start[joined[:, 1]]
    return solve_winding(len(triangles), joined // 3, agree, triangle_areas(points, triangles))

"""Positions of vertices, predicted across the edges of the mesh: the fourth corner of a parallelogram."""

from __future__ import annotations

from functools import partial

import numpy as np

from ...arrays import Array, Indices
from ...mesh.edges import connected_parts, edge_keys, stable_order
from ...native.library import reason_against
from ...native.predicted import Parallelograms
from .growth import Coder, Reading, mean_of, rounds

ANYWHERE = 1e9
"""Steps by which a position may be off that nothing predicts."""


def code_positions(triangles: Indices, steps: Array, code: Coder) -> Array:
    """Find the positions, (V, 3), of the vertices of triangles (T, 3): what `code` makes of their predictions.

    Each vertex has its step, (V,).

    In each edge-connected part the corners of the first triangle are predicted to be at the origin, and so are vertices
    without triangles.  All others are the mean of a + b - c over the triangles (a, b, c) across an edge (a, b) that the
    vertex shares a triangle with.
    """
    links, first = _across_edges(triangles)
    known = np.ones(len(steps), dtype=bool)
    known[triangles] = False
    known[triangles[first]] = True
    seeds = np.flatnonzero(known)
    positions, each = np.zeros((len(steps), 3)), steps[:, None]
    positions[seeds] = code(seeds, positions[seeds], each[seeds], ANYWHERE * each[seeds] + positions[seeds])
    compiled = None if reason_against() else Parallelograms(links)
    if compiled and isinstance(code, Reading) and code.values:
        code.numbers.demand_read(code.values.positions(compiled, known, positions, code.sizes, steps))
        return positions
    means = compiled.means if compiled else partial(_means, links)
    for places, used, owner in rounds(links[:, 0], links[:, 1:], known):
        mean = means(positions, code.sizes, used, owner, len(places))
        positions[places] = code(places, mean[:, :3], each[places], mean[:, 3:])
    return positions


def _means(links: Indices, positions: Array, sizes: Array, used: Indices, owner: Indices, count: int) -> Array:
    """Means of what links suggest and of the sizes of their ends, (count, 6), over those that each owner has."""
    a, b, c = (links[used, k] for k in (1, 2, 3))
    suggested = positions[a] + positions[b] - positions[c]
    off = (sizes[a] + sizes[b] + sizes[c]) / 3.0
    return mean_of(np.concatenate([suggested, off], axis=1), owner, count)


def _across_edges(triangles: Indices) -> tuple[Indices, Indices]:
    """Return links (target, a, b, c), and the first triangle of each part that edges connect."""
    start, end = np.roll(triangles, -1, axis=1).ravel(), np.roll(triangles, -2, axis=1).ravel()
    keys = edge_keys(start, end, int(triangles.max(initial=0)) + 1)
    order = stable_order(keys)
    same = np.flatnonzero(np.diff(keys[order]) == 0)
    one, two = order[same], order[same + 1]
    far = triangles.ravel()
    links = np.stack([far[one], start[one], end[one], far[two]], axis=1)
    back = links[:, [3, 1, 2, 0]]
    _, part = connected_parts(one // 3, two // 3, len(triangles))
    return np.concatenate([links, back]), np.unique(part, return_index=True)[1]

"""Positions of vertices, predicted across the edges of the mesh: the fourth corner of a parallelogram."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

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


def _means(
    links: NDArray[np.int32], positions: Array, sizes: Array, used: Indices, owner: Indices, count: int
) -> Array:
    """Means of what links suggest and of the sizes of their ends, (count, 6), over those that each owner has."""
    a, b, c = (links[used, k] for k in (1, 2, 3))
    suggested = positions[a] + positions[b] - positions[c]
    off = (sizes[a] + sizes[b] + sizes[c]) / 3.0
    return mean_of(np.concatenate([suggested, off], axis=1), owner, count)


def _across_edges(triangles: Indices) -> tuple[NDArray[np.int32], Indices]:
    """Return links (target, a, b, c), and the first triangle of each part that edges connect."""
    far = triangles.astype(np.int32).ravel()
    start, end = (np.roll(far.reshape(-1, 3), -k, axis=1).ravel() for k in (1, 2))
    keys = edge_keys(start.astype(np.int64), end.astype(np.int64), int(triangles.max(initial=0)) + 1)
    order = stable_order(keys)
    same = np.flatnonzero(np.diff(keys[order]) == 0)
    one, two = order[same], order[same + 1]
    links = np.empty((2, len(one), 4), dtype=np.int32)
    links[0, :, 0] = links[1, :, 3] = far.take(one)
    links[0, :, 3] = links[1, :, 0] = far.take(two)
    links[:, :, 1], links[:, :, 2] = start.take(one), end.take(one)
    _, part = connected_parts(one // 3, two // 3, len(triangles))
    # parts are numbered by their first triangles
    return links.reshape(-1, 4), np.flatnonzero(np.diff(np.maximum.accumulate(part), prepend=-1))

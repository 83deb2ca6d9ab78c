"""Smaller triangles where they are wanted, without hanging vertices: longest edges are halved (Rivara 1984)."""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Booleans, Indices
from .edges import edge_keys


def bisected(vertices: Array, triangles: Indices, wanted: Booleans) -> tuple[Array, Indices]:
    """Halve the sides of some triangles, and the longest sides of those around them.

    The wanted triangles become four each.  Where a side of another triangle was halved, its longest side is halved too;
    so no angle ever falls below half of the smallest one at the start.

    Parameters
    ----------
    vertices, triangles
        (V, 3) and (T, 3); no edge belongs to more than two triangles.
    wanted
        Which triangles to refine, (T,).

    Returns
    -------
    Vertices, the old ones first, and triangles wound as before.
    """
    count = len(vertices)
    # side k runs from corner k to corner k + 1; the longest one comes first
    sides = np.roll(vertices[triangles], -1, axis=1) - vertices[triangles]
    triangles = np.take_along_axis(triangles, _from(_longest(sides, triangles, count)), axis=1)
    keys, edge = np.unique(edge_keys(triangles, np.roll(triangles, -1, axis=1), count), return_inverse=True)
    edge = edge.reshape(-1, 3)
    halved = np.zeros(len(keys), dtype=bool)
    halved[edge[wanted]] = True
    while (missing := halved[edge].any(axis=1) & ~halved[edge[:, 0]]).any():
        halved[edge[missing, 0]] = True
    middle = np.full(len(keys), -1)
    middle[halved] = count + np.arange(int(halved.sum()))
    start, end = np.divmod(keys[halved], count)
    a, b, c = triangles.T
    first, second, third = middle[edge].T
    done = first >= 0
    # the halves a-first-c and first-b-c, each halved again where its other old side is
    pieces = [triangles[~done]]
    for one, other, tip, cut in ((c, a, first, third), (b, c, first, second)):
        whole, again = done & (cut < 0), done & (cut >= 0)
        pieces.append(np.stack([one, other, tip], axis=1)[whole])
        pieces += [np.stack([one, cut, tip], axis=1)[again], np.stack([cut, other, tip], axis=1)[again]]
    return np.concatenate([vertices, 0.5 * (vertices[start] + vertices[end])]), np.concatenate(pieces)


def _longest(sides: Array, triangles: Indices, count: int) -> Indices:
    """Number of the longest of each triangle's sides (T, 3, 3), (T,); of equally long ones the same from both sides."""
    keys = edge_keys(triangles, np.roll(triangles, -1, axis=1), count)
    lengths = np.linalg.norm(sides, axis=2)
    order = np.lexsort((keys.ravel(), lengths.ravel()))
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    longest: Indices = rank.reshape(-1, 3).argmax(axis=1)
    return longest


def _from(first: Indices) -> Indices:
    """The three corners of each triangle from this one on, (T, 3)."""
    return (first[:, None] + np.arange(3)) % 3

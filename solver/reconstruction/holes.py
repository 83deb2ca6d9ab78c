"""Holes of a cloud closed up to a size: points laid across them, for the base only.

The triangles of least area that close a hole's border (Liepa 2003) say where such points go.  With them the base is
made again, and where it follows no others it is smoothed until it continues the surface around it.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist

from ..arrays import Array, Indices
from ..mesh.edges import edge_keys
from ..mesh.sampling import triangle_grid

MOST_CORNERS = 120
"""Vertices of a border between which triangles are sought; of longer ones some are left out, evenly."""

FINEST = 64
"""Most parts into which the sides of such a triangle are split for points."""

FREE_SPACINGS = 1.0
"""Where the base is farther than this from every point, and nearer to one across a hole, it is smoothed."""

BRIDGED_SPACINGS = 2.0
"""Beyond this it is smoothed anyway: balls around the points met across a gap, and it sinks between them."""


def across_holes(vertices: Array, triangles: Indices, widest: float, spacing: float) -> Array:
    """Points across the holes of a manifold that are at most `widest` wide, about `spacing` apart, (N, 3)."""
    found = [np.zeros((0, 3))]
    for border in narrow_holes(vertices, triangles, widest):
        found += [_spread(border[triangle], spacing) for triangle in least_area(border)]
    return np.concatenate(found)


def narrow_holes(vertices: Array, triangles: Indices, widest: float) -> list[Array]:
    """Borders of a manifold that are at most `widest` wide, each as a polygon (n, 3) of at most `MOST_CORNERS`."""
    found = []
    for loop in border_loops(triangles):
        border = vertices[loop]
        border = border[np.linspace(0, len(border), min(len(border), MOST_CORNERS), endpoint=False).astype(np.int64)]
        if len(border) >= 3 and pdist(border).max() <= widest:
            found.append(border)
    return found


def border_loops(triangles: Indices) -> list[Indices]:
    """Closed borders of a manifold whose triangles are wound consistently: their vertices in order."""
    count = int(triangles.max(initial=-1)) + 1
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    _, number, uses = np.unique(edge_keys(start, end, count), return_inverse=True, return_counts=True)
    alone = uses[number] == 1
    following = dict(zip(start[alone].tolist(), end[alone].tolist(), strict=True))
    loops = []
    while following:
        loop = [next(iter(following))]
        while (beyond := following.pop(loop[-1], None)) is not None:
            loop.append(beyond)
        loops.append(np.array(loop[:-1], dtype=np.int64))
    return loops


def without_small_holes(vertices: Array, triangles: Indices, widest: float) -> tuple[Array, Indices]:
    """Close the holes of a manifold that are at most `widest` wide by fans around their middles."""
    middles, fans = [vertices], [triangles]
    for loop in border_loops(triangles):
        if len(loop) < 3:  # what is left of a border where parts meet at single vertices
            continue
        if np.ptp(vertices[loop], axis=0).max() <= widest and pdist(vertices[loop]).max() <= widest:
            tip = np.full(len(loop), len(vertices) + len(middles) - 1)
            fans.append(np.stack([np.roll(loop, -1), loop, tip], axis=1))
            middles.append(vertices[loop].mean(axis=0, keepdims=True))
    return np.concatenate(middles), np.concatenate(fans)


def least_area(border: Array) -> Indices:
    """Triangles of the least total area between the vertices of a closed polygon (n, 3), by dynamic programming."""
    n = len(border)
    area, apex = np.zeros((n, n)), np.zeros((n, n), dtype=np.int64)
    for length in range(2, n):
        i = np.arange(n - length)[:, None]
        k, j = i + np.arange(1, length), i + length
        sides = np.cross(border[k] - border[i], border[j] - border[i])
        total = area[i, k] + area[k, j] + 0.5 * np.linalg.norm(sides, axis=2)
        best = total.argmin(axis=1)
        area[i[:, 0], j[:, 0]] = total[np.arange(len(best)), best]
        apex[i[:, 0], j[:, 0]] = i[:, 0] + 1 + best
    found, left = [], [(0, n - 1)]
    while left:
        one, other = left.pop()
        if other - one > 1:
            tip = int(apex[one, other])
            found.append((one, tip, other))
            left += [(one, tip), (tip, other)]
    return np.array(found, dtype=np.int64).reshape(-1, 3)


def _spread(corners: Array, spacing: float) -> Array:
    """Points of a triangle (3, 3), about a spacing apart, (N, 3)."""
    longest = float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).max())
    return triangle_grid(int(np.clip(np.ceil(longest / spacing), 1, FINEST))) @ corners


def faired(vertices: Array, triangles: Indices, points: Array, spacing: float, across: Array | None = None) -> Array:
    """Smooth a mesh where it follows no points of the cloud (P, 3), but those across holes (N, 3) if they are given.

    Minimises the sum of the squared Laplacians, all other vertices fixed: a thin plate that is tangent to the mesh.
    """
    to_points = cKDTree(points).query(vertices)[0]
    free = to_points > (BRIDGED_SPACINGS if across is None else FREE_SPACINGS) * spacing
    if across is not None:
        free &= to_points > cKDTree(across).query(vertices)[0]
    if not free.any() or free.all():
        return vertices
    count = len(vertices)
    one, other = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    linked = sp.csr_matrix((np.ones(2 * len(one)), (np.r_[one, other], np.r_[other, one])), shape=(count, count))
    linked.data[:] = 1.0
    laplacian = sp.identity(count) - sp.diags(1.0 / np.asarray(linked.sum(axis=1)).ravel()) @ linked
    bending = (laplacian.T @ laplacian).tocsr()[free]
    result = vertices.copy()
    result[free] = splu(bending[:, free].tocsc()).solve(-(bending[:, ~free] @ vertices[~free]))
    return result

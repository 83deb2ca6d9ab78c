"""The closest points of a triangle mesh, and values between the corners of triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array, Indices, rows_at, sum_of

FIRST_CANDIDATES = 8
PAIRS_AT_ONCE = 200_000

ROUNDING = 1e-9
"""Share of the largest triangle's radius by which distances may be rounded."""


@dataclass(frozen=True)
class Footpoints:
    """Where N points lie on a mesh.

    Attributes
    ----------
    triangle
        (N,).
    barycentric
        (N, 3), in [0, 1], one in sum.
    """

    triangle: Indices
    barycentric: Array

    def on(self, vertices: Array, triangles: Indices) -> Array:
        """Positions on a mesh of these triangles, (N, 3)."""
        return interpolate(vertices, triangles[self.triangle], self.barycentric)


def interpolate(values: Array, corners: Indices, barycentric: Array) -> Array:
    """Values (V, D) between the corners (N, 3) of triangles, (N, D)."""
    result = rows_at(values, corners[:, 0]) * barycentric[:, :1]
    for k in (1, 2):
        result += rows_at(values, corners[:, k]) * barycentric[:, k, None]
    return result


def closest_points(points: Array, vertices: Array, triangles: Indices) -> Footpoints:
    """Closest point of a triangle mesh for each of the points (N, 3); exact.

    Triangles are tried in the order of their centroids' distances, except those of which no point can be closer than
    what was found: none is farther from its centroid than the farthest corner.  Once that holds for the largest
    triangle, it holds for all that are left.
    """
    ends = vertices[triangles]
    centroids = ends.mean(axis=1)
    radius = np.linalg.norm(ends - centroids[:, None], axis=2).max(axis=1)
    largest = float(radius.max())
    radius += ROUNDING * largest
    tree = cKDTree(centroids)
    found = _Closest(points, ends)
    pending, tried, wanted = np.arange(len(points)), 0, min(FIRST_CANDIDATES, len(triangles))
    while len(pending):
        still = []
        for part in np.array_split(pending, max(1, -(-len(pending) * wanted // PAIRS_AT_ONCE))):
            distance, candidates = tree.query(points[part], k=list(range(tried + 1, wanted + 1)))
            least = distance - radius[candidates]
            for columns in (slice(0, 1), slice(1, None)):
                found.take(part, candidates[:, columns], least[:, columns])
            still.append(part[distance[:, -1] - largest < found.apart[part]])
        pending = np.concatenate(still) if wanted < len(triangles) else pending[:0]
        tried, wanted = wanted, min(2 * wanted, len(triangles))
    return Footpoints(found.triangle, found.barycentric)


class _Closest:
    """The closest of the triangles (T, 3, 3) that were tried so far for each of the points (N, 3)."""

    def __init__(self, points: Array, ends: Array) -> None:
        self._points, self._ends = points, ends
        self.apart = np.full(len(points), np.inf)
        self.triangle = np.zeros(len(points), dtype=np.int64)
        self.barycentric = np.zeros((len(points), 3))

    def take(self, part: Indices, candidates: Indices, least: Array) -> None:
        """Try candidates (n, k) for points (n,), from which they are at least so far, (n, k); the first of equals."""
        row, column = np.nonzero(least < self.apart[part][:, None])
        point, triangle = part[row], candidates[row, column]
        places, ends = self._points[point], self._ends[triangle]
        shares = closest_on_triangle(places, ends)
        apart = np.linalg.norm((ends * shares[:, :, None]).sum(axis=1) - places, axis=1)
        best = np.lexsort((column, apart, row))
        best = best[np.diff(row[best], prepend=-1) > 0]
        best = best[apart[best] < self.apart[point[best]]]
        closer = point[best]
        self.apart[closer], self.triangle[closer] = apart[best], triangle[best]
        self.barycentric[closer] = shares[best]


def closest_on_triangle(points: Array, ends: Array) -> Array:
    """Barycentric coordinates (N, 3) of the closest point of one triangle (N, 3, 3) for each point (N, 3).

    The closest point lies inside, or on the closest of the three sides.
    """
    sides = np.roll(ends, -1, axis=1) - ends
    squared = sum_of(sides**2)
    along = sum_of((points[:, None] - ends) * sides)
    share = np.clip(np.divide(along, squared, out=np.zeros_like(along), where=squared > 0.0), 0.0, 1.0)
    on_side = ends + share[:, :, None] * sides
    nearest = sum_of((on_side - points[:, None]) ** 2).argmin(axis=1)
    row = np.arange(len(points))
    result = np.zeros((len(points), 3))
    result[row, nearest] = 1.0 - share[row, nearest]
    result[row, (nearest + 1) % 3] = share[row, nearest]
    normal = np.cross(sides[:, 0], sides[:, 1])
    area = (normal**2).sum(axis=1)
    inside = np.stack(
        [(np.cross(sides[:, (k + 1) % 3], points - ends[:, (k + 1) % 3]) * normal).sum(axis=1) for k in range(3)],
        axis=1,
    )
    within = (inside >= 0.0).all(axis=1) & (area > 0.0)
    result[within] = inside[within] / inside[within].sum(axis=1, keepdims=True)
    return result

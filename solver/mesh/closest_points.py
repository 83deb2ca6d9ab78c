"""The closest points of a triangle mesh, and values between the corners of triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array, Indices

FIRST_CANDIDATES = 8
PAIRS_AT_ONCE = 1_000_000


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
    result: Array = (values[corners] * barycentric[:, :, None]).sum(axis=1)
    return result


def closest_points(points: Array, vertices: Array, triangles: Indices) -> Footpoints:
    """Closest point of a triangle mesh for each of the points (N, 3); exact.

    Triangles are tried in the order of their centroids' distances; as no point of a triangle is farther from its
    centroid than the largest circumscribed radius, the search knows when no other triangle can be closer.
    """
    ends = vertices[triangles]
    centroids = ends.mean(axis=1)
    largest = float(np.linalg.norm(ends - centroids[:, None], axis=2).max())
    tree = cKDTree(centroids)
    best = np.full(len(points), np.inf)
    triangle = np.zeros(len(points), dtype=np.int64)
    barycentric = np.zeros((len(points), 3))
    pending, tried, wanted = np.arange(len(points)), 0, min(FIRST_CANDIDATES, len(triangles))
    while len(pending):
        still = []
        for part in np.array_split(pending, max(1, -(-len(pending) * wanted // PAIRS_AT_ONCE))):
            distance, candidates = tree.query(points[part], k=list(range(tried + 1, wanted + 1)))
            for column in candidates.T:
                shares = closest_on_triangle(points[part], ends[column])
                apart = np.linalg.norm((ends[column] * shares[:, :, None]).sum(axis=1) - points[part], axis=1)
                closer = apart < best[part]
                where = part[closer]
                best[where], triangle[where], barycentric[where] = apart[closer], column[closer], shares[closer]
            still.append(part[distance[:, -1] - largest < best[part]])
        pending = np.concatenate(still) if wanted < len(triangles) else pending[:0]
        tried, wanted = wanted, min(2 * wanted, len(triangles))
    return Footpoints(triangle, barycentric)


def closest_on_triangle(points: Array, ends: Array) -> Array:
    """Barycentric coordinates (N, 3) of the closest point of one triangle (N, 3, 3) for each point (N, 3).

    The closest point lies inside, or on the closest of the three sides.
    """
    sides = np.roll(ends, -1, axis=1) - ends
    squared = (sides**2).sum(axis=2)
    along = ((points[:, None] - ends) * sides).sum(axis=2)
    share = np.clip(np.divide(along, squared, out=np.zeros_like(along), where=squared > 0.0), 0.0, 1.0)
    on_side = ends + share[:, :, None] * sides
    nearest = ((on_side - points[:, None]) ** 2).sum(axis=2).argmin(axis=1)
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

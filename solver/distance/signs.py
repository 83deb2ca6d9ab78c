"""On which side of a mesh places lie, by winding numbers, without computing one for each place.

Between a place and the nearest point of the mesh there is no surface, so a place lies where that side of the nearest
triangle lies.  Just off a triangle the winding number is the one without this triangle, plus or minus one half.

Beside an open surface, a scan of one side of a part, the winding number is near one half on both sides and decides
nothing.  There the front of the nearest triangle is outside.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..arrays import Array, Booleans, Indices
from ..mesh.edges import edge_keys
from ..mesh.normals import face_normals, normals_around
from .targets import Nearest
from .winding import WindingNumbers

SMALL = 1.0 / 200.0
"""A triangle smaller than this share of the mesh lies on one side of all else: its middle speaks for it."""

UNDECIDED = 0.25
"""Winding numbers within this distance of one half decide nothing."""

SHARED_PLACES = np.array([[1, 1, 1], [0.9, 0.05, 0.05], [0.05, 0.9, 0.05], [0.05, 0.05, 0.9]]) / [[3], [1], [1], [1]]
STEEP = float(np.cos(np.radians(44.0)))
STRAIGHT_ABOVE = 1.0 - 1e-9
CLOSE = 3.0
"""Near an open border the winding number changes gradually: only places within this many radii of a triangle share
its side."""


class Sides:
    """Which places lie inside a mesh: vertices (V, 3), triangles (T, 3)."""

    def __init__(self, vertices: Array, triangles: Indices) -> None:
        self._vertices, self._triangles = vertices, triangles
        self._winding = WindingNumbers(vertices, triangles)
        self._normals = face_normals(vertices, triangles)
        corners = vertices[triangles]
        self._radius = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2).max(axis=1)

    def inside(self, points: Array, found: Nearest) -> Booleans:
        """Return which of the points (N, 3), with their nearest points on the mesh, lie inside."""
        offset = points - found.foot
        height = (offset * self._normals[found.element]).sum(axis=1)
        known = np.abs(height) >= STRAIGHT_ABOVE * found.distance
        known |= self._gentle[found.element]
        if not self._is_closed:
            known &= found.distance <= CLOSE * self._radius[found.element]
        used, place = np.unique(found.element[known], return_inverse=True)
        result = np.zeros(len(points), dtype=bool)
        if 2 * len(used) < np.count_nonzero(known):
            of_triangle, agreed = self._sides_of(used)
            above = (height[known] > 0.0).astype(np.int64)
            result[known] = of_triangle[place, above]
            known[known] = agreed[place]
        else:
            known[:] = False
        result[~known] = self._decided(self._winding.decide(points[~known]), height[~known] < 0.0)
        return result

    def _decided(self, winding: Array, behind: Booleans) -> Booleans:
        """Return what is inside by winding numbers, or by which places are behind their triangle, (n,)."""
        off = np.abs(winding) - 0.5
        return np.where(np.abs(off) > UNDECIDED, off > 0.0, behind != self._inside_out)

    def _sides_of(self, used: Indices) -> tuple[Booleans, Booleans]:
        """Return whether below and above each triangle is inside, (n, 2), and whether that holds all over it, (n,)."""
        extent = float(np.ptp(self._vertices[self._triangles].reshape(-1, 3), axis=0).max())
        large = np.flatnonzero(self._radius[used] > SMALL * extent)
        sides = self._sides_at(used, SHARED_PLACES[0])
        agreed = np.ones(len(used), dtype=bool)
        for shares in SHARED_PLACES[1:]:
            agreed[large] &= (self._sides_at(used[large], shares) == sides[large]).all(axis=1)
        return sides, agreed

    def _sides_at(self, used: Indices, shares: Array) -> Booleans:
        places = (self._vertices[self._triangles[used]] * shares[:, None]).sum(axis=1)
        between = self._winding.decide(places)  # a triangle sees a place in its plane at no angle
        behind = np.ones(len(used), dtype=bool)
        return np.stack([self._decided(between + 0.5, behind), self._decided(between - 0.5, ~behind)], axis=1)

    @cached_property
    def _inside_out(self) -> bool:
        """Whether the triangles' fronts look inwards."""
        some = self._triangles[:: max(1, len(self._triangles) // 256)]
        between = self._winding.decide(self._vertices[some].mean(axis=1))
        return bool(np.median(between) < -UNDECIDED)

    @cached_property
    def _open_vertices(self) -> Booleans:
        """Vertices at an edge that does not join two triangles of the same winding."""
        one, other = self._triangles.ravel(), np.roll(self._triangles, -1, axis=1).ravel()
        _, edge, count = np.unique(edge_keys(one, other, len(self._vertices)), return_inverse=True, return_counts=True)
        forward = np.bincount(edge, one < other, len(count))
        bad = ((count != 2) | (forward != 1))[edge]
        result = np.zeros(len(self._vertices), dtype=bool)
        result[one[bad]] = result[other[bad]] = True
        return result

    @property
    def _is_closed(self) -> bool:
        return not self._open_vertices.any()

    @cached_property
    def _gentle(self) -> Booleans:
        """Triangles at whose corners all triangles are within 88 degrees of each other, and none is missing, (T,).

        A place nearest to a corner or a side of such a triangle lies on the same side of it as of its neighbours.
        """
        around = normals_around(self._normals, self._triangles, len(self._vertices))
        leaning = (around[self._triangles] * self._normals[:, None]).sum(axis=2)
        steep = self._open_vertices.copy()
        steep[self._triangles[leaning < STEEP]] = True
        return np.asarray(~steep[self._triangles].any(axis=1))

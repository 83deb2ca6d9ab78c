"""The tangent planes of a cloud: a surface through the points stays near the planes of those around it."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array, Booleans, Indices, row_blocks, rows_at, sum_of
from .geometry import CloudGeometry, neighbours, spacings

PLANES = 6
"""Points around a position whose planes are compared with it."""

NEIGHBOURS = 9
"""Points, with itself, that show how dense a point lies."""

SPACINGS_OFF = 0.4
NOISE_LEVELS_OFF = 3.0
"""A surface leaves the cloud where it is farther from all planes around than the sum of this many spacings and this
many noise levels."""

SPIKE_SPACINGS = 1.0
"""A surface that is farther from the planes than this many spacings, and as many noise levels as above, is a spike
where its base is nearer."""

NEARER = 0.5
"""It is if the base's distance from the planes is less than this share of its own."""

ROOM_SPACINGS = 1.5
"""A surface has run away where it is farther from its base, and from the nearest point, than this many spacings and as
many noise levels as above."""


NEAR_SPACINGS = 3.0
"""A surface that has run away is still nearer the cloud than its base if it is within this many spacings and as many
noise levels as above of a point, and its base is farther from the points."""


class TangentPlanes:
    """Tangent planes of a cloud.

    Attributes
    ----------
    room
        How far from both its base and the points a surface may be at least, scene units.
    tolerance
        Distance from the planes, scene units, above which a surface has left the cloud.
    spike
        The same where the base may take its place.
    """

    def __init__(self, points: Array, geometry: CloudGeometry) -> None:
        """Take the points (P, 3) that `geometry` was taken from."""
        self._points, self._normals = points, geometry.normals
        self._tree = cKDTree(points)
        distance, near = neighbours(self._tree, min(NEIGHBOURS, len(points)))
        # on a border points have neighbours on one side only, and seem sparser than those beside them
        own = spacings(distance)[near].min(axis=1)
        self._sparser = np.maximum(own - geometry.spacing, 0.0)
        self.room = ROOM_SPACINGS * geometry.spacing + NOISE_LEVELS_OFF * geometry.noise
        self.tolerance = SPACINGS_OFF * geometry.spacing + NOISE_LEVELS_OFF * geometry.noise
        self.spike = SPIKE_SPACINGS * geometry.spacing + NOISE_LEVELS_OFF * geometry.noise
        self._near = NEAR_SPACINGS * geometry.spacing + NOISE_LEVELS_OFF * geometry.noise

    def run_away(self, positions: Array, on_base: Array) -> Array:
        """How much too far positions (N, 3) are from the base, at (N, 3), and from the points, (N,).

        Tangent planes have no end: along them a surface may leave the cloud and seem near.  Where points are sparser,
        the surface has more room.
        """
        away = np.linalg.norm(positions - on_base, axis=1)
        far = np.flatnonzero(away > self.room)
        away[far] = np.minimum(away[far], self._tree.query(positions[far])[0])
        room = np.full(len(away), self.room)
        room[far] += ROOM_SPACINGS * self._sparser[self._tree.query(on_base[far])[1]]
        return np.maximum(away - room, 0.0)

    def nearer(self, positions: Array, on_base: Array) -> Booleans:
        """Which positions (N, 3) are near the points, in a gap between some of them, and nearer than the base, (N,).

        Points that were drawn at random have such gaps.  Where the base cuts an edge off it is no better.
        """
        away = self._tree.query(positions)[0]
        return np.asarray((away <= self._near) & (away < self._tree.query(on_base)[0]), dtype=np.bool_)

    def spikes(self, positions: Array, on_base: Array) -> Booleans:
        """Which positions (N, 3) are far off the planes while the base, at (N, 3), is near them, (N,)."""
        off = self.distance(positions)
        room = self.spike + SPIKE_SPACINGS * self._sparser[self._tree.query(on_base)[1]]
        return np.asarray((off > room) & (self.distance(on_base) < NEARER * off), dtype=np.bool_)

    def distance(self, positions: Array) -> Array:
        """Distance of positions (N, 3) from the nearest of the planes of the points around them, (N,)."""
        distance: Array = np.abs(self._heights(positions)[0]).min(axis=1)
        return distance

    def on_nearest(self, positions: Array) -> Array:
        """Positions (N, 3), moved onto the nearest of the planes of the points around them."""
        height, near = self._heights(positions)
        nearest = np.arange(len(positions)), np.abs(height).argmin(axis=1)
        return positions - height[nearest][:, None] * self._normals[near[nearest]]

    def _heights(self, positions: Array) -> tuple[Array, Indices]:
        """Heights of positions (N, 3) over the planes of the points around them, and these points, (N, k) each."""
        count = min(PLANES, len(self._points))
        height, near = np.empty((len(positions), count)), np.empty((len(positions), count), dtype=np.int64)
        for rows in row_blocks(len(positions)):
            own = self._tree.query(positions[rows], k=count)[1].reshape(-1, count)
            offset = positions[rows, None] - rows_at(self._points, own)
            height[rows], near[rows] = sum_of(offset * rows_at(self._normals, own)), own
        return height, near

"""The tangent planes of a cloud: a surface through the points stays near the planes of those around it."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array
from .geometry import CloudGeometry

PLANES = 6
"""Points around a position whose planes are compared with it."""

SPACINGS_OFF = 0.4
NOISE_LEVELS_OFF = 3.0
"""A surface leaves the cloud where it is farther from all planes around than the sum of this many spacings and this
many noise levels."""


class TangentPlanes:
    """Tangent planes of a cloud.

    Attributes
    ----------
    tolerance
        Distance from the planes, scene units, above which a surface has left the cloud.
    """

    def __init__(self, points: Array, geometry: CloudGeometry) -> None:
        """Take the points (P, 3) that `geometry` was taken from."""
        self._points, self._normals = points, geometry.normals
        self._tree = cKDTree(points)
        self.tolerance = SPACINGS_OFF * geometry.spacing + NOISE_LEVELS_OFF * geometry.noise

    def distance(self, positions: Array) -> Array:
        """Distance of positions (N, 3) from the nearest of the planes of the points around them, (N,)."""
        near = self._tree.query(positions, k=min(PLANES, len(self._points)))[1].reshape(len(positions), -1)
        offset = positions[:, None] - self._points[near]
        distance: Array = np.abs((offset * self._normals[near]).sum(axis=2)).min(axis=1)
        return distance

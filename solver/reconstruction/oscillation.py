"""Patches that run away from a cloud between its points, and taming them by lower degrees.

Where points are few a polynomial of high degree may pass through all of them and swing far out in between.  No residual
tells; but the points' tangent planes do: a surface through the points stays near the planes of those around it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..mesh.sampling import triangle_grid
from ..patches.blending import PLATEAU
from .geometry import CloudGeometry

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SPLITS = 5
PLANES = 6
FARTHEST = 0.4
NOISE_LEVELS = 3.0
"""A patch runs away where its part of the surface is farther from all planes around than so many spacings and noise
levels."""

TAMER = 0.6
LOWEST_DEGREE = 2


class Planes:
    """Tangent planes of a cloud."""

    def __init__(self, points: Array, geometry: CloudGeometry) -> None:
        """Take the points (P, 3) that `geometry` was taken from."""
        self._points, self._normals = points, geometry.normals
        self._tree = cKDTree(points)
        self.tolerance = FARTHEST * geometry.spacing + NOISE_LEVELS * geometry.noise

    def distance(self, positions: Array) -> Array:
        """Distance of positions (N, 3) from the nearest of the planes of the points around them, (N,)."""
        near = self._tree.query(positions, k=min(PLANES, len(self._points)))[1].reshape(len(positions), -1)
        offset = positions[:, None] - self._points[near]
        distance: Array = np.abs((offset * self._normals[near]).sum(axis=2)).min(axis=1)
        return distance


def farthest(patches: Indices, planes: Planes, sampled: Callable[[int], tuple[Array, Array]]) -> Array:
    """How far each of these patches leaves the planes of the points around it, (n,), scene units; more than
    `planes.tolerance` is running away.

    Parameters
    ----------
    patches
        Their numbers, (n,).
    sampled
        Gives a patch's own surface at samples of its triangles, (m, 3), and its blending weights there, (m,).
    """
    pieces = [sampled(int(patch)) for patch in patches]
    away = planes.distance(np.concatenate([points for points, _ in pieces]))
    # at its rim a patch has no weight, but what is far off there is off beside it too
    away *= np.concatenate([blending for _, blending in pieces]) + PLATEAU
    starts = np.cumsum([0, *(len(blending) for _, blending in pieces[:-1])])
    result: Array = np.maximum.reduceat(away, starts)
    return result


def tamed(degrees: Indices) -> Indices:
    """Lower degrees for patches that run away."""
    return np.maximum((TAMER * degrees).astype(np.int64), LOWEST_DEGREE)


SAMPLES = triangle_grid(SPLITS)

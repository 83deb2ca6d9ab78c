"""The result of a reconstruction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ..approximation.report import Report
from ..arrays import Array, Booleans, Indices
from ..surface.representation import Representation


@dataclass(frozen=True)
class Reconstruction:
    """A surface fitted to P points.

    Attributes
    ----------
    vertices
        The surface at the base's vertices, (V, 3), scene units.
    error
        Distance of each point from the surface, (P,), scene units; 0 where coordinates are not finite.
    triangle, barycentric
        The surface's point nearest to each point: triangle of the base (P,) and barycentric coordinates (P, 3).
    weights
        How much each point counted, in [0, 1], (P,); 0 for what was left out.
    used
        Which points were not left out as strays or not finite, (P,).
    measures
        Measures, counts and times.
    representation
        What evaluates the surface anywhere on the base.
    """

    vertices: Array
    error: Array
    triangle: Indices
    barycentric: Array
    weights: Array
    used: Booleans
    measures: Report
    representation: Representation

    @cached_property
    def report(self) -> dict[str, Any]:
        """The measures as a dictionary of plain values."""
        return self.measures.as_dict()

    def error_near(self, points: Array, positions: Array) -> Array:
        """Error of the points around positions (N, 3), for a heat map of the surface, (N,)."""
        return self.carried(points, positions, self.error[:, None])[:, 0]

    def carried(self, points: Array, positions: Array, attribute: Array) -> Array:
        """Carry an attribute of the points, (P, k), to positions (N, 3); returns (N, k).

        The mean of the four nearest points that were used, weighted with the inverse of their distance.
        """
        points, attribute = points[self.used], attribute[self.used]
        count = min(4, len(points))
        distance, nearest = cKDTree(points).query(positions, k=count)
        share = 1.0 / (distance.reshape(len(positions), count) + 1e-9 * float(np.ptp(points, axis=0).max()) + 1e-300)
        values = attribute[nearest.reshape(len(positions), count)]
        result: Array = (share[:, :, None] * values).sum(axis=1) / share.sum(axis=1)[:, None]
        return result

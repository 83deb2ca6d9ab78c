"""Working towards a tolerance: smaller triangles of the base, and so smaller patches, where points are off.

The base is refined where that helps: in triangles with enough points for smaller patches, and not for the sake of
noise, which no surface should follow.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..approximation.tolerance import MARGIN
from ..arrays import Array, Booleans
from ..mesh.closest_points import Footpoints
from ..mesh.refinement import bisected
from ..mesh.triangle_mesh import TriangleMesh
from .base import checked_base
from .oscillation import CloudSurface

ROUNDS = 4
"""How often a base is refined at most."""

LEAST_GAIN, PATIENCE = 0.05, 2
"""Rounds end when this many in a row take away a smaller share of the points outside.  The first often takes none: new
vertices lie on a coarse surface, and only the next round lets them leave it."""

FEWEST_POINTS = 10
"""A triangle with fewer is not refined: its parts would not afford functions that follow them."""

NOISE_LEVELS = 3.0
"""Points closer than this many noise levels are not off the surface, whatever the tolerance."""

COUNTED = 0.1
"""A point with a smaller weight is an outlier, and need not lie within the tolerance."""


@dataclass(frozen=True)
class Fitted:
    """A fitted surface with what the report says of its points.

    Attributes
    ----------
    surface
        The surface; its mesh is the base.
    weights
        How much each point counts, (P,).
    feet, distance
        The place on the surface nearest to each point, and how far it is, (P,).
    parametric
        How far each point is from the place at which it was observed, (P,).
    iterations
        See `measured_iterations`.
    copied
        How many vertices are the base's own.
    """

    surface: CloudSurface
    weights: Array
    feet: Footpoints
    distance: Array
    parametric: Array
    iterations: dict[str, list[float]]
    copied: int

    def outside(self, tolerance: float, noise: float) -> Booleans:
        """Which points are farther from the surface than they may be, (P,)."""
        farthest = max(MARGIN * tolerance, NOISE_LEVELS * noise)
        return np.asarray((self.distance > farthest) & (self.weights >= COUNTED), dtype=np.bool_)


@dataclass
class ToleranceSought:
    """What it took to work towards a tolerance.

    Attributes
    ----------
    requested
        The tolerance, scene units.
    outside_at_first, outside
        Points farther from the surface than it and than three noise levels, before the first round and at the end.
    rounds
        Vertices of the base, and points outside, of each round.
    """

    requested: float
    outside_at_first: int
    outside: int
    rounds: list[dict[str, int]] = field(default_factory=list)

    def as_dict(self, fitted: Fitted) -> dict[str, Any]:
        """Return it as the report has it, with the largest distance of a point that counts, scene units."""
        counted = fitted.distance[fitted.weights >= COUNTED]
        return {
            "requested": self.requested,
            "points_outside_at_first": self.outside_at_first,
            "points_outside": self.outside,
            "rounds": self.rounds,
            "achieved": float(counted.max(initial=0.0)),
        }


def refined_base(fitted: Fitted, outside: Booleans) -> TriangleMesh | None:
    """Refine the base where points are outside, (P,); None where that would not help."""
    mesh = fitted.surface.mesh
    wanted = np.zeros(len(mesh.triangles), dtype=bool)
    wanted[fitted.feet.triangle[outside]] = True
    wanted &= np.bincount(fitted.feet.triangle, minlength=len(wanted)) >= FEWEST_POINTS
    if not wanted.any():
        return None
    return checked_base(*bisected(mesh.vertices, mesh.triangles, wanted))

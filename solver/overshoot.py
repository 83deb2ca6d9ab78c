"""Patches that oscillate between their observations.

A polynomial may pass near every vertex and centroid and still swing out in between.  Such patches are rare; they are
found by looking at points that were not observed, and fitted again with six observations in every triangle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .observations import MeshObservations, PatchObservations
from .patch_fit import PatchFit, values_at
from .sampling import SURFACE_SAMPLES
from .settings import Settings

NEAR_EDGES = SURFACE_SAMPLES[3:]
"""The points that are farthest from both vertices and centroid."""

OVERSHOOT = 2.0
"""A patch overshoots where its largest error in between is so many times the largest at its observations."""


def overshooting(observations: MeshObservations, fits: list[PatchFit], settings: Settings) -> NDArray[np.bool_]:
    """Which patches swing out between their observations, (K,); errors count with the patch's blending weight."""
    result = np.zeros(len(fits), dtype=bool)
    for patch, fit in enumerate(fits):
        own = observations.of_patch(patch)
        inner, points = observations.between(patch, NEAR_EDGES)
        between = _largest_error(values_at(fit, inner, settings) - points, inner)
        observed = _largest_error(fit.values - observations.points[own.number], own)
        result[patch] = between > OVERSHOOT * observed
    return result


def _largest_error(differences: NDArray[np.float64], at: PatchObservations) -> float:
    error = np.linalg.norm(differences, axis=1) * at.blending
    return float(error.max(initial=0.0))

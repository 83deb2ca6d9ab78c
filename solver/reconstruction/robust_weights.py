"""Robust weights: how much a point counts, by its distance from the surface (Huber 1964; Beaton, Tukey 1974).

Least squares with these weights, updated after each fit, minimise a loss that grows slower than the square.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array

TUNING = {"huber": 1.345, "tukey": 4.685}
"""Distances, in standard deviations of good points, at which weights begin to fall (Huber) or are zero (Tukey): at
these values 95 % of the efficiency of least squares is left on normally distributed errors."""

NORMAL_MEDIAN = 0.6744897501960817
"""Median of the absolute value of a standard normal variable."""


def spread(distance: Array) -> float:
    """Standard deviation of the good points, from the median of the distances, (P,), which outliers hardly move."""
    return float(np.median(distance)) / NORMAL_MEDIAN if len(distance) else 0.0


def robust_weights(distance: Array, kind: str, scale: float) -> Array:
    """Weights of points in [0, 1], (P,).

    Parameters
    ----------
    distance
        Distances from the surface, (P,).
    kind
        "none", "huber" or "tukey".
    scale
        Standard deviation of the good points; with zero all weights are one.
    """
    if kind == "none" or scale <= 0.0:
        return np.ones(len(distance))
    relative = distance / (TUNING[kind] * scale)
    if kind == "huber":
        return np.minimum(1.0, 1.0 / np.maximum(relative, 1.0))
    return np.asarray(np.maximum(1.0 - relative**2, 0.0) ** 2, dtype=np.float64)

"""The functions that a quadric over a plane consists of."""

from __future__ import annotations

import numpy as np

from ..arrays import Array


def quadric_terms(u: Array, v: Array, axis: int) -> Array:
    """Return 1, u, v, u^2, u v, v^2 along a new `axis` of length 6."""
    return np.stack((np.ones_like(u), u, v, u * u, u * v, v * v), axis=axis)

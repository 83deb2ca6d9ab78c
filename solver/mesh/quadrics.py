"""The functions that a quadric over a plane consists of."""

from __future__ import annotations

import numpy as np

from ..arrays import Array


def quadric_terms(u: Array, v: Array, axis: int) -> Array:
    """Return 1, u, v, u^2, u v, v^2 along a new `axis` of length 6."""
    terms = np.empty((*u.shape[:axis], 6, *u.shape[axis:]))
    one, of_u, of_v, uu, uv, vv = np.moveaxis(terms, axis, 0)
    one[...], of_u[...], of_v[...] = 1.0, u, v
    for square, (a, b) in ((uu, (u, u)), (uv, (u, v)), (vv, (v, v))):
        np.multiply(a, b, out=square)
    return terms

"""Fixed points inside triangles, at which surfaces are observed and errors measured."""

from __future__ import annotations

import numpy as np

_NEAR, _FAR = 0.091576213509771, 0.445948490915965
SURFACE_SAMPLES = np.array(
    [
        [1 - 2 * _NEAR, _NEAR, _NEAR],
        [_NEAR, 1 - 2 * _NEAR, _NEAR],
        [_NEAR, _NEAR, 1 - 2 * _NEAR],
        [1 - 2 * _FAR, _FAR, _FAR],
        [_FAR, 1 - 2 * _FAR, _FAR],
        [_FAR, _FAR, 1 - 2 * _FAR],
    ]
)
"""Barycentric coordinates of six interior points (Dunavant 1985, the rule of degree 4), (6, 3)."""


LATTICE = np.array([[4 - i - j, i, j] for i in range(5) for j in range(5 - i)]) / 4.0
"""Barycentric coordinates of a lattice that quarters every edge, corners included, (15, 3)."""

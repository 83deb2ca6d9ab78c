"""Fixed points inside triangles, at which surfaces are observed and errors measured."""

from __future__ import annotations

import numpy as np

from ..arrays import Array

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

CENTROID = np.full((1, 3), 1.0 / 3.0)


def triangle_grid(splits: int) -> Array:
    """Barycentric coordinates of the grid that splits a triangle's sides evenly, ((n + 1) (n + 2) / 2, 3)."""
    i, j = np.divmod(np.arange((splits + 1) ** 2), splits + 1)
    inside = i + j <= splits
    i, j = i[inside], j[inside]
    return np.column_stack([splits - i - j, i, j]) / splits


LATTICE = triangle_grid(4)
"""The grid that quarters every side, corners included, (15, 3)."""

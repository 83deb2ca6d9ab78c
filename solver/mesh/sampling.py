"""Fixed points inside triangles: some at which surfaces are observed, and others at which errors are measured."""

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

_A, _B, _C = 0.659027622374092, 0.231933368553031, 0.109039009072877
MEASURED_SAMPLES = np.array([[_A, _B, _C], [_A, _C, _B], [_B, _A, _C], [_B, _C, _A], [_C, _A, _B], [_C, _B, _A]])
"""Barycentric coordinates of six points of equal weight (Strang and Fix 1973, degree 3), (6, 3).

Errors are measured here.  Nothing is ever fitted to these points.
"""

CENTROID = np.full((1, 3), 1.0 / 3.0)


def triangle_grid(splits: int) -> Array:
    """Barycentric coordinates of the grid that splits a triangle's sides evenly, ((n + 1) (n + 2) / 2, 3)."""
    i, j = np.divmod(np.arange((splits + 1) ** 2), splits + 1)
    inside = i + j <= splits
    i, j = i[inside], j[inside]
    return np.column_stack([splits - i - j, i, j]) / splits


LATTICE = triangle_grid(4)
"""The grid that quarters every side, corners included, (15, 3)."""

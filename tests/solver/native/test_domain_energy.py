"""The kernel's step limit against determinants along the way."""

from __future__ import annotations

from ctypes import c_double, c_void_p

import numpy as np
from sparse_surface.solver.native.library import function


def limit(jacobian: np.ndarray, change: np.ndarray, floor: float, instructions: str) -> float:
    """Largest step of one triangle, from matrices (2, 2)."""
    largest_step = function("largest_step", instructions)
    largest_step.restype = c_double
    arrays = [np.ascontiguousarray(matrix.ravel()) for matrix in (jacobian, change)]
    return float(largest_step(*(c_void_p(array.ctypes.data) for array in arrays), 1, c_double(floor)))


def test_the_determinant_stays_above_the_floor_up_to_the_limit_and_no_farther(instructions: str) -> None:
    rng = np.random.default_rng(3)
    limited = 0
    for _ in range(200):
        jacobian, change = np.eye(2) + rng.normal(0.0, 0.2, (2, 2)), rng.normal(size=(2, 2))
        floor = 0.02
        step = limit(jacobian, change, floor, instructions)
        way = np.linspace(0.0, min(step, 50.0), 400)
        determinants = np.linalg.det(jacobian + way[:, None, None] * change)
        assert (determinants >= floor - 1e-9).all()
        if np.isfinite(step):
            limited += 1
            assert np.linalg.det(jacobian + 1.001 * step * change + 1e-12) < floor
    assert 50 < limited < 200


def test_a_triangle_below_the_floor_may_not_fall_further(instructions: str) -> None:
    flat = np.diag([1.0, 0.01])
    assert limit(flat, np.diag([0.0, -1.0]), 0.02, instructions) == 0.0
    assert limit(flat, np.diag([0.0, 1.0]), 0.02, instructions) == np.inf

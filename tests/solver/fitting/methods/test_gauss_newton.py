"""The Gauss-Newton systems against dense ones, assembled from cotangents and matrix products."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sparse_surface.solver.fitting import batch as batch_module
from sparse_surface.solver.fitting.batch import Batch, build_batch
from sparse_surface.solver.fitting.methods import gauss_newton
from synthetic import crease, hill, problem

Array = NDArray[np.float64]


def cotangent_laplacian(points: Array, triangles: NDArray[np.int64]) -> Array:
    """Return the stiffness matrix of linear elements, (m, m): minus half the sum of the opposite cotangents."""
    matrix = np.zeros((len(points), len(points)))
    for triangle in triangles:
        for k in range(3):
            tip, one, other = triangle[k], triangle[(k + 1) % 3], triangle[(k + 2) % 3]
            a, b = points[one] - points[tip], points[other] - points[tip]
            half = 0.5 * (a @ b) / abs(a[0] * b[1] - a[1] * b[0])
            matrix[one, other] -= half
            matrix[other, one] -= half
            matrix[one, one] += half
            matrix[other, other] += half
    return matrix


def dense_system(
    batch: Batch, k: int, orthonormal: Array, gradient: Array, beta1: float, beta2: float, damping: float
) -> Array:
    """Return J^T J + (beta1 + damping) I + beta2 L of problem k for its vertices' u, then v; padding included."""
    problems, (_, _, vertices) = batch.problems, batch.start.shape
    observations = gradient.shape[-1]
    whole = batch.observe.toarray()[: problems * observations, : problems * vertices]
    observe = whole[k * observations : (k + 1) * observations, k * vertices : (k + 1) * vertices]
    system = (beta1 + damping) * np.eye(2 * vertices)
    for rows, slopes in zip(orthonormal[k], gradient[:, k].swapaxes(0, 1), strict=True):
        change = np.hstack([slopes[0][:, None] * observe, slopes[1][:, None] * observe])
        jacobian = change - rows.T @ (rows @ change)
        system += jacobian.T @ jacobian
    faces = len(batch.triangles) // problems
    triangles = batch.triangles[k * faces : (k + 1) * faces] - k * vertices
    laplacian = cotangent_laplacian(batch.start[:, k].T, triangles[np.diff(np.sort(triangles), axis=1).min(axis=1) > 0])
    system += beta2 * np.kron(np.eye(2), laplacian)
    return system


@pytest.mark.parametrize("steepness", [1.0, 1e7])
def test_the_move_solves_the_dense_system(monkeypatch: pytest.MonkeyPatch, steepness: float) -> None:
    monkeypatch.setattr(batch_module, "in_single_precision", lambda matrix: matrix)
    monkeypatch.setattr(gauss_newton, "CONJUGATE_GRADIENT_STEPS", 2000)
    batch = build_batch([problem(crease, 5, seed=1, inside=True), problem(hill, 6, seed=2, inside=True)])
    rng = np.random.default_rng(3)
    real = batch.root_weights > 0.0
    shape = (2, 3, batch.values.shape[-1])
    orthonormal = np.linalg.qr((rng.normal(size=(*shape[:2], 4, shape[2])) * real[:, None]).swapaxes(-1, -2))[0]
    gradient = rng.normal(size=(2, *shape)) * real * steepness
    force = rng.normal(size=batch.start.shape)
    damping = np.array([0.3, 0.0])
    unit = steepness**2
    move = gauss_newton.gauss_newton_move(
        batch, orthonormal.swapaxes(-1, -2), gradient, (0.7 * unit, 2.0 * unit), damping * unit, force
    )
    for k in range(2):
        system = dense_system(
            batch, k, orthonormal.swapaxes(-1, -2), gradient, 0.7 * unit, 2.0 * unit, damping[k] * unit
        )
        expected: Any = np.linalg.solve(system, force[:, k].ravel())
        np.testing.assert_allclose(move[:, k].ravel(), expected, atol=1e-7 * np.abs(expected).max())


def test_a_few_steps_in_single_precision_come_near_the_solution() -> None:
    """Measured in the energy that the steps minimise, x^T A x / 2 - f^T x: 0 at the start, lowest at the solution."""
    batch = build_batch([problem(crease, 7, seed=1, inside=True)])
    rng = np.random.default_rng(5)
    rows = np.linalg.qr(rng.normal(size=(1, 3, batch.values.shape[-1], 4)))[0].swapaxes(-1, -2)
    gradient, force = rng.normal(size=(2, *batch.values.shape)), rng.normal(size=batch.start.shape)
    move = gauss_newton.gauss_newton_move(batch, rows, gradient, (0.2, 0.1), np.zeros(1), force).ravel()
    system = dense_system(batch, 0, rows, gradient, 0.2, 0.1, 0.0)
    lowest = -0.5 * force.ravel() @ np.linalg.solve(system, force.ravel())
    assert 0.5 * move @ system @ move - force.ravel() @ move <= 0.95 * lowest

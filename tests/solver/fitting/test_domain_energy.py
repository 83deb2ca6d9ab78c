"""Q1 and Q2 against singular values, finite differences and a search along the step."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from sparse_surface.solver.fitting.domain_energy import DomainEnergy, determinant, largest_step, nearest_rotation
from synthetic import grid

Array = NDArray[np.float64]
TRIANGLE = np.array([[0, 1, 2]])
matrices = arrays(np.float64, (2, 2), elements=st.floats(-10.0, 10.0, allow_subnormal=False))


def some_energy(side: int = 6, seed: int = 3) -> DomainEnergy:
    points, triangles = grid(side, seed)
    return DomainEnergy.of(points.T.copy(), triangles)


def moved(energy: DomainEnergy, seed: int = 4, amount: float = 0.15) -> Array:
    """Return a domain in which some triangles have turned over."""
    domain: Array = energy.start + np.random.default_rng(seed).normal(0.0, amount, energy.start.shape)
    return domain


def signed_singular_values(jacobian: Array) -> Array:
    """Return the singular values (2,) with the smaller one negative where the matrix turns the plane over."""
    values = np.linalg.svd(jacobian, compute_uv=False)
    values[1] *= 1.0 if np.linalg.det(jacobian) >= 0.0 else -1.0
    return values


@given(matrices)
def test_rigidity_is_that_of_the_signed_singular_values(jacobian: Array) -> None:
    energy = DomainEnergy.of(np.array([[0.0, 2.0, 0.0], [0.0, 0.0, 1.0]]), TRIANGLE)  # of area 1
    expected = ((signed_singular_values(jacobian) - 1.0) ** 2).sum()
    found = energy.rigidity(jacobian[:, :, None])[0]
    assert abs(found - expected) <= 1e-12 * max(1.0, (jacobian**2).sum())


def test_rigidity_of_whole_domains_agrees_with_the_singular_values_of_every_triangle() -> None:
    energy = some_energy()
    jacobian = energy.jacobian(moved(energy))
    assert (determinant(jacobian) < 0.0).any()
    values = np.array([signed_singular_values(jacobian[:, :, t]) for t in range(jacobian.shape[2])])
    expected = energy.area * ((values - 1.0) ** 2).sum(axis=1)
    np.testing.assert_allclose(energy.rigidity(jacobian), expected, rtol=1e-12, atol=1e-12)


@given(matrices)
def test_nearest_rotation_is_the_one_of_the_singular_vectors(jacobian: Array) -> None:
    left, values, right = np.linalg.svd(jacobian)
    if values[0] - values[1] < 1e-6 * max(values[0], 1e-3) and np.linalg.det(jacobian) < 0.0:
        return  # every rotation is about as near
    rotation = left @ np.diag([1.0, np.linalg.det(left @ right)]) @ right
    found = nearest_rotation(jacobian[:, :, None])[:, :, 0]
    np.testing.assert_allclose(found @ found.T, np.eye(2), atol=1e-12)
    assert np.linalg.norm(jacobian - found) <= np.linalg.norm(jacobian - rotation) + 1e-9


def test_no_rotation_is_nearest_to_a_reflection() -> None:
    np.testing.assert_array_equal(nearest_rotation(np.diag([1.0, -1.0])[:, :, None])[:, :, 0], np.eye(2))


def test_the_initial_domain_turned_and_moved_costs_nothing() -> None:
    energy = some_energy()
    cosine, sine = np.cos(0.7), np.sin(0.7)
    domain = np.array([[cosine, -sine], [sine, cosine]]) @ energy.start + [[1.0], [2.0]]
    assert energy.rigidity(energy.jacobian(domain)).max() < 1e-12
    assert np.abs(energy.rigidity_gradient(energy.jacobian(domain))).max() < 1e-12
    assert energy.proximity(energy.start).max() == 0.0


def test_areas_and_jacobians_are_those_of_affine_maps() -> None:
    points, triangles = grid(6, 3)
    energy = DomainEnergy.of(points.T.copy(), triangles)
    matrix = np.array([[1.3, 0.4], [-0.2, 0.7]])
    jacobian = energy.jacobian(matrix @ energy.start + [[5.0], [1.0]])
    np.testing.assert_allclose(jacobian, np.broadcast_to(matrix[:, :, None], jacobian.shape), atol=1e-12)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    np.testing.assert_allclose(energy.area, np.abs(np.linalg.det(np.stack([b - a, c - a], axis=1))) / 2, rtol=1e-12)


def test_gradient_agrees_with_finite_differences() -> None:
    energy = some_energy()
    domain = moved(energy)
    gradient = energy.rigidity_gradient(energy.jacobian(domain))
    step = 1e-6
    differences = np.zeros_like(domain)
    for place in np.ndindex(*domain.shape):
        ends = []
        for sign in (1.0, -1.0):
            other = domain.copy()
            other[place] += sign * step
            ends.append(energy.rigidity(energy.jacobian(other)).sum())
        differences[place] = (ends[0] - ends[1]) / (2 * step)
    np.testing.assert_allclose(gradient, differences, atol=1e-6 * np.abs(gradient).max())


def test_laplacian_is_half_the_hessian_at_the_initial_domain_along_moves_that_keep_the_rotations() -> None:
    energy = some_energy()
    stretch = energy.start * [[1.0], [0.5]]  # a symmetric Jacobian: the nearest rotations stay the identity
    along = np.einsum("cn,cn->", stretch, np.stack([energy.laplacian() @ x for x in stretch]))
    step = 0.25
    assert energy.rigidity(energy.jacobian(energy.start + step * stretch)).sum() == pytest.approx(along * step**2)


def test_triangles_without_area_weigh_nothing() -> None:
    start = np.array([[0.0, 1.0, 0.0, 0.5], [0.0, 0.0, 1.0, 0.0]])
    energy = DomainEnergy.of(start, np.array([[0, 1, 2], [0, 0, 0], [0, 1, 3]]))
    jacobian = energy.jacobian(start * 1.7)
    np.testing.assert_array_equal(energy.area[1:], 0.0)
    np.testing.assert_array_equal(energy.rigidity(jacobian)[1:], 0.0)
    assert np.isfinite(energy.rigidity_gradient(jacobian)).all()


@given(jacobian=matrices, change=matrices, floor=st.sampled_from([0.0, 0.02, 0.5]))
def test_largest_step_is_where_the_determinant_first_meets_the_floor(
    jacobian: Array, change: Array, floor: float
) -> None:
    if np.linalg.det(jacobian) <= floor + 1e-6:
        return
    step = float(largest_step(jacobian[:, :, None], change[:, :, None], floor)[0])
    scale = max(1.0, np.abs(jacobian).max(), np.abs(change).max() * (step if np.isfinite(step) else 100.0)) ** 2
    until = np.linspace(0.0, step if np.isfinite(step) else 100.0, 200)
    along = jacobian[:, :, None] + until * change[:, :, None]
    assert determinant(along).min() >= floor - 1e-9 * scale
    if np.isfinite(step):
        assert np.linalg.det(jacobian + step * change) == pytest.approx(floor, abs=1e-7 * scale)


def test_a_move_that_only_turns_and_grows_triangles_has_no_limit() -> None:
    """det(I + x dJ) = (1 - 0.1 x)^2 + x^2 >= 1 / 1.01: the quadratic has no root above the floor."""
    turning = np.array([[-0.1, -1.0], [1.0, -0.1]])[:, :, None]
    assert largest_step(np.eye(2)[:, :, None], turning, 0.02)[0] == np.inf
    assert np.isfinite(largest_step(np.eye(2)[:, :, None], turning, 0.995)[0])


def test_a_triangle_below_the_floor_may_rise_but_not_fall() -> None:
    jacobian = np.diag([0.1, 0.1])[:, :, None]
    up, down = np.eye(2)[:, :, None], -np.eye(2)[:, :, None]
    assert largest_step(jacobian, down, 0.02)[0] == 0.0
    assert largest_step(jacobian, up, 0.02)[0] == np.inf

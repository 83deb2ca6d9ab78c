"""The default patch solver against finite differences, dense least squares and closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sparse_surface.solver import Settings
from sparse_surface.solver.fitting import batch as batch_module
from sparse_surface.solver.fitting.batch import build_batch
from sparse_surface.solver.fitting.dictionary import Dictionary
from sparse_surface.solver.fitting.methods import variable_projection
from sparse_surface.solver.fitting.methods.variable_projection import (
    State,
    downhill,
    function_gradient,
    regularisation,
    solve,
)
from sparse_surface.solver.fitting.sparse_fit import least_squares, select
from synthetic import crease, hill, problem

LEGENDRE = Dictionary(14, "legendre")
WEIGHTS = (0.2, 0.1)
SETTINGS = Settings(beta1=0.2, beta2=0.1).resolved()


def batch_of(*heights, inside=True):
    return build_batch([problem(height, 10 + k, seed=k, inside=inside) for k, height in enumerate(heights)])


def test_the_downhill_direction_is_half_the_gradient_by_finite_differences():
    batch = batch_of(crease, hill)
    rng = np.random.default_rng(1)
    real = np.arange(batch.start.shape[2]) < batch.sizes[:, None]
    domain = batch.start + 0.01 * rng.normal(size=batch.start.shape) * real
    support = select(batch, LEGENDRE, domain, 8, "ols").support

    def objective(moved):
        flat = moved.reshape(2, -1)
        fit = least_squares(batch, LEGENDRE, moved, support)
        return (fit.misfit + regularisation(batch, flat, batch.energy.jacobian(flat), WEIGHTS)).sum()

    state = State.at(domain, least_squares(batch, LEGENDRE, domain, support))
    jacobian = batch.energy.jacobian(domain.reshape(2, -1))
    force = downhill(batch, state, function_gradient(batch, LEGENDRE, state.fit), jacobian, WEIGHTS)
    for _ in range(5):
        direction = rng.normal(size=domain.shape) * real
        difference = (objective(domain + 1e-6 * direction) - objective(domain - 1e-6 * direction)) / 2e-6
        assert difference == pytest.approx(-2.0 * (force.reshape(domain.shape) * direction).sum(), rel=1e-5)


def objective_by_hand(batch, domain, support):
    """Eq. 3 of the only problem, with dense least squares and the singular values of each triangle's Jacobian."""
    functions, root = LEGENDRE.evaluate(batch.observed(domain))[0], batch.root_weights[0, 0]
    total = WEIGHTS[0] * ((domain - batch.start) ** 2).sum()
    for chosen, values in zip(support[0], batch.values[0], strict=True):
        rows = (functions[chosen] * root).T
        total += ((values * root - rows @ np.linalg.lstsq(rows, values * root, rcond=None)[0]) ** 2).sum()
    before, after = batch.start[:, 0].T, domain[:, 0].T
    for a, b, c in batch.triangles:
        edges = [np.stack([points[b] - points[a], points[c] - points[a]], axis=1) for points in (before, after)]
        jacobian = edges[1] @ np.linalg.inv(edges[0])
        singular = np.linalg.svd(jacobian, compute_uv=False) * [1.0, np.sign(np.linalg.det(jacobian))]
        total += WEIGHTS[1] * 0.5 * abs(np.linalg.det(edges[0])) * ((singular - 1.0) ** 2).sum()
    return total


def test_a_step_uphill_is_not_taken_and_raises_the_damping(monkeypatch):
    batch = batch_of(crease)
    fit = select(batch, LEGENDRE, batch.start, 8, "ols")
    low = objective_by_hand(batch, batch.start, fit.support)
    uphill = None

    def moved(batch, orthonormal, gradient, weights, damping, force):
        nonlocal uphill
        direction = -force / np.abs(force).max()
        lengths = 0.1 * 0.8 ** np.arange(40)
        rises = [objective_by_hand(batch, batch.start + length * direction, fit.support) / low for length in lengths]
        uphill, length = next((rise, length) for rise, length in zip(rises, lengths, strict=True) if rise < 1.2)
        return length * direction

    monkeypatch.setattr(variable_projection, "gauss_newton_move", moved)
    state = State.at(batch.start.copy(), fit)
    energy = variable_projection.step(batch, LEGENDRE, state, WEIGHTS)
    assert 1.01 < uphill < 1.2
    np.testing.assert_array_equal(state.domain, batch.start)
    assert energy[0] == pytest.approx(low, rel=1e-6)
    assert state.damping[0] > 0.0
    assert state.settled[0]
    before = state.damping.copy()
    variable_projection.step(batch, LEGENDRE, state, WEIGHTS)
    assert (state.damping > before).all()


def test_a_step_downhill_is_taken_and_lowers_the_damping():
    batch = batch_of(crease)
    fit = select(batch, LEGENDRE, batch.start, 8, "ols")
    low = objective_by_hand(batch, batch.start, fit.support)
    state = State.at(batch.start.copy(), fit)
    state.damping[:] = 1e-3
    energy = variable_projection.step(batch, LEGENDRE, state, WEIGHTS)
    assert energy[0] == pytest.approx(objective_by_hand(batch, state.domain, fit.support), rel=1e-3)  # the ridge
    assert energy[0] < 0.95 * low
    assert state.damping[0] < 1e-3


def test_coefficients_are_those_of_dense_weighted_least_squares():
    batch = batch_of(crease, hill)
    fit = select(batch, LEGENDRE, batch.start, 15, "ols")
    functions = LEGENDRE.evaluate(batch.observed(batch.start))
    for k in range(2):
        root = batch.root_weights[k, 0]
        for d in range(3):
            rows = functions[k, fit.support[k, d]] * root
            expected = np.linalg.lstsq(rows.T, batch.values[k, d] * root, rcond=None)[0]
            # fitted values rather than coefficients: nearly dependent functions may share theirs in many ways
            np.testing.assert_allclose(fit.coefficients[k, d] @ rows, expected @ rows, atol=1e-8)


@pytest.mark.parametrize(("height", "share"), [(crease, 0.35), (hill, 0.15)])
def test_the_energy_falls_and_the_fit_is_far_better_than_over_the_fixed_domain(height, share):
    batch = build_batch([problem(height, 18, inside=True)])
    fixed, moved = (solve(batch, LEGENDRE, replace(SETTINGS, iterations=count)) for count in (0, 15))
    energy = np.array(moved.trace.energy)[:, 0]
    assert (np.diff(energy) <= 0.0).all()
    assert moved.trace.squared_error[-1][0] < share * fixed.trace.squared_error[-1][0]


def doubled_areas(batch, domain):
    u, v = domain.reshape(2, -1)
    a, b, c = batch.triangles.T
    return (u[b] - u[a]) * (v[c] - v[a]) - (v[b] - v[a]) * (u[c] - u[a])


def test_no_triangle_falls_below_the_determinant_floor():
    """Linear functions fit plateaus only over a domain that shrinks each of them to a point."""
    flat = problem(lambda u, v: 0.0 * u, 12, degree=1)
    plateaus = np.tanh(6.0 * flat.signals)
    batch = build_batch([replace(flat, signals=plateaus, values=plateaus)])
    solution = solve(batch, Dictionary(1, "legendre"), replace(SETTINGS, iterations=60, beta1=1e-9, beta2=0.0))
    shares = doubled_areas(batch, solution.domain) / doubled_areas(batch, batch.start)
    assert shares.min() >= 0.02 - 1e-12
    assert shares.min() < 0.03, "nothing came near the floor"


@pytest.mark.parametrize(
    ("single", "iterations", "within"), [(False, 3, 1e-11), (False, 15, 1e-9), (True, 3, 1e-6), (True, 15, 1e-5)]
)
def test_padding_changes_nothing(monkeypatch, single, iterations, within):
    """Sums over more entries may be rounded differently: in double precision that does not show."""
    if not single:
        monkeypatch.setattr(batch_module, "in_single_precision", lambda matrix: matrix)
    how = replace(SETTINGS, sparsity=12, iterations=iterations)
    alone = solve(build_batch([problem(crease, 9, inside=True)]), LEGENDRE, how)
    both = build_batch([problem(crease, 9, inside=True), problem(hill, 14, inside=True)])
    together = solve(both, LEGENDRE, how)
    assert np.abs(alone.domain - build_batch([problem(crease, 9, inside=True)]).start).max() > 1e-3
    np.testing.assert_allclose(together.domain[:, 0, :81], alone.domain[:, 0], atol=within)
    np.testing.assert_array_equal(together.support[0], alone.support[0])


def batch_of_three():
    return batch_of(crease, hill, lambda u, v: 0.3 * u**2 - 0.4 * u * v)


def test_some_problems_of_a_batch_are_what_they_were_in_it():
    whole, which = batch_of_three(), np.array([2, 0])
    part = whole.only(which)
    moved = whole.start + 0.01 * np.random.default_rng(3).normal(size=whole.start.shape)
    np.testing.assert_array_equal(part.observed(moved[:, which]), whole.observed(moved)[:, which])
    forces = np.random.default_rng(4).normal(size=(2, 3, whole.values.shape[2]))
    np.testing.assert_allclose(part.collected(forces[:, which]), whole.collected(forces)[:, which], atol=1e-13)
    jacobians = part.by_problem(part.energy.jacobian(moved[:, which].reshape(2, -1)))
    expected = whole.by_problem(whole.energy.jacobian(moved.reshape(2, -1)))[..., which, :]
    np.testing.assert_allclose(jacobians, expected, atol=1e-12)


def test_problems_that_settled_stay_and_the_others_end_as_in_one_batch(monkeypatch):
    how = replace(SETTINGS, sparsity=12, iterations=15)
    monkeypatch.setattr(variable_projection, "SETTLED", 0.012)
    monkeypatch.setattr(variable_projection, "WORTH_MAKING_SMALLER", 0.0)
    together = solve(batch_of_three(), LEGENDRE, how)
    monkeypatch.setattr(variable_projection, "WORTH_MAKING_SMALLER", 1.0)
    apart = solve(batch_of_three(), LEGENDRE, how)
    assert len(apart.trace.energy) == len(together.trace.energy) == 15
    energies, longer = np.array(apart.trace.energy), np.array(together.trace.energy)
    ended = (np.diff(energies, axis=0) == 0.0).sum(axis=0)
    assert ended.min() > 0, "none settled"
    assert len(np.unique(ended)) > 1, "all settled at once"
    # A problem by itself ends where a step gains it little; in the batch it goes along for nothing.
    assert (energies[-1] >= longer[-1] * (1.0 - 1e-6)).all()
    assert (energies[-1] <= longer[-1] * 1.6).all()
    for k in range(3):
        last = 15 - ended[k] - 1
        gained = 1.0 - energies[last, k] / energies[last - 1, k]
        assert gained < variable_projection.SETTLED or last == 14


def test_a_polynomial_is_reproduced_over_its_own_domain():
    batch = batch_of(lambda u, v: 0.3 * u**3 - 0.2 * u * v**2 + 0.1 * v, inside=False)
    solution = solve(batch, LEGENDRE, replace(SETTINGS, iterations=3))
    assert np.sqrt(solution.trace.squared_error[-1][0] / 100) < 1e-10


@pytest.mark.parametrize("count", [1, 3, 7])
def test_patches_with_fewer_vertices_than_functions_are_fitted(count):
    few = build_batch([problem(hill, 3, inside=True)])
    solution = solve(few, LEGENDRE, replace(SETTINGS, iterations=count))
    assert np.isfinite(solution.coefficients).all()
    assert np.isfinite(solution.domain).all()

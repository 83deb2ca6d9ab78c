"""The augmented-Lagrangian iteration against finite differences, SciPy and a plain one for a single patch."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar
from sklearn.linear_model import orthogonal_mp
from sparse_surface.benchmarks.generated_models import cube
from sparse_surface.solver import Settings, approximate
from sparse_surface.solver.fitting.batch import Batch, Problem, build_batch
from sparse_surface.solver.fitting.dictionary import Dictionary
from sparse_surface.solver.fitting.methods import augmented_lagrangian as paper_method
from sparse_surface.solver.fitting.methods.augmented_lagrangian import Iteration, closed_form_f
from synthetic import crease, hill, problem

Array = NDArray[np.float64]

PRINTED = Settings(method="paper").resolved()
CONVERGING = replace(PRINTED, rho=1.0, initial_fit="data")
DICTIONARY = Dictionary(14, "monomial")


def batch_of(*problems: Problem) -> Batch:
    return build_batch(list(problems), turn=False)


def iteration_over(batch: Batch, settings: Settings, seed: int = 0) -> Iteration:
    """Return an iteration in mid-course: the domain moved, multipliers that are not zero."""
    rng = np.random.default_rng(seed)
    iteration = Iteration(batch, DICTIONARY, settings, batch.start, batch.values)
    iteration.domain = batch.start + rng.normal(0.0, 0.01, batch.start.shape)
    iteration.multipliers = rng.normal(0.0, 0.01, batch.values.shape)
    return iteration


# -------------------------------------------------------------------------------------------------------- the U-step


@pytest.mark.parametrize(
    "reading", [{}, {"regularisation": "vertex"}, {"rigidity_reference": "previous"}, {"rho": 7.0}]
)
@pytest.mark.parametrize("inside", [False, True])
def test_gradient_of_the_domain_step_agrees_with_finite_differences(reading: dict, inside: bool) -> None:
    settings = replace(PRINTED, **reading)
    batch = batch_of(problem(side=7, seed=1, inside=inside), problem(hill, side=8, seed=2, inside=inside))
    iteration = iteration_over(batch, settings)
    objective = iteration.objective(iteration.choose())
    points = iteration.domain.swapaxes(0, 1).reshape(batch.problems, -1)
    gradient = objective(points)[1]
    step = 1e-5
    differences = np.zeros_like(points)
    for place in range(points.shape[1]):  # the problems are independent, so all of them at once
        ends = []
        for sign in (1.0, -1.0):
            moved = points.copy()
            moved[:, place] += sign * step
            ends.append(objective(moved)[0])
        differences[:, place] = (ends[0] - ends[1]) / (2 * step)
    np.testing.assert_allclose(gradient, differences, atol=1e-6 * np.abs(gradient).max())
    assert (np.abs(gradient).max(axis=1) > 1e-3).all()


@pytest.mark.parametrize("reading", [{}, {"regularisation": "vertex"}, {"rigidity_reference": "previous"}])
def test_the_domain_step_finds_the_minimum_that_bfgs_finds(reading: dict) -> None:
    """For each patch by itself, padded or not, from a domain in mid-course."""
    batch = batch_of(problem(side=9, seed=3), problem(hill, side=7, seed=4))
    iteration = iteration_over(batch, replace(CONVERGING, **reading))
    objective = iteration.objective(fit := iteration.choose())
    start = iteration.domain.swapaxes(0, 1).reshape(2, -1)
    moved = iteration.move(fit, np.ones(2, dtype=bool)).swapaxes(0, 1).reshape(2, -1)
    before, after = objective(start)[0], objective(moved)[0]
    for k in range(2):

        def of_one(x: Array, k: int = k) -> tuple[float, Array]:
            points = start.copy()
            points[k] = x
            value, gradient = objective(points)
            return value[k], gradient[k]

        reference = minimize(of_one, start[k], jac=True, method="BFGS").fun
        assert before[k] - after[k] >= 0.99 * (before[k] - reference) > 0.0


def test_the_domains_of_problems_that_have_stopped_stay() -> None:
    batch = batch_of(problem(side=8, seed=3), problem(hill, side=8, seed=4))
    iteration = iteration_over(batch, CONVERGING)
    moved = iteration.move(iteration.choose(), np.array([False, True]))
    np.testing.assert_array_equal(moved[:, 0], iteration.domain[:, 0])
    assert np.abs(moved[:, 1] - iteration.domain[:, 1]).max() > 1e-4


# ------------------------------------------------------------------------------------------------------ the f-step


@given(b=st.floats(-2, 2), h=st.floats(-2, 2), multiplier=st.floats(-1, 1), rho=st.sampled_from([0.1, 1.0, 10.0]))
def test_closed_form_is_the_minimum(b: float, h: float, multiplier: float, rho: float) -> None:
    def objective(f: float) -> float:
        return (b - f) ** 2 + rho / 2 * (f - h + multiplier / rho) ** 2

    found = float(closed_form_f(np.array(b), np.array(h), np.array(multiplier), rho))
    assert found == pytest.approx(minimize_scalar(objective, options={"xtol": 1e-12}).x, abs=1e-5)
    assert found == pytest.approx((2 * b + rho * (h - multiplier / rho)) / (2 + rho), abs=1e-12)


# ------------------------------------------------------------------------------------------------- the iteration


class OnePatch:
    """Section 3.3 for one signal of one patch, step by step: scikit-learn's pursuit, SciPy's BFGS, no weights."""

    def __init__(self, batch: Batch, settings: Settings, *, zero: bool) -> None:
        self.batch, self.settings = batch, settings
        self.data = batch.values[0]
        self.f = np.zeros_like(self.data) if zero else self.data.copy()
        self.multipliers = np.zeros_like(self.data)
        self.domain = batch.start[:, 0].copy()

    def fitted(self, domain: Array) -> Array:
        return self.coefficients @ DICTIONARY.evaluate(domain)

    def regularisation(self, domain: Array) -> float:
        energy = self.batch.energy
        triangles = energy.rigidity(energy.jacobian(domain)).sum()
        return float(self.settings.beta1 * ((domain - energy.start) ** 2).sum() + self.settings.beta2 * triangles)

    def step(self) -> float:
        rho, tau = self.settings.rho, self.settings.tau
        target = self.f + self.multipliers / rho
        columns = DICTIONARY.evaluate(self.domain).T
        norm = np.linalg.norm(columns, axis=0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            coefficients = orthogonal_mp(columns / norm, target.T, n_nonzero_coefs=15, precompute=True)
        self.coefficients = coefficients.reshape(len(norm), -1).T / norm
        objective = Iteration(self.batch, DICTIONARY, self.settings, self.batch.start, self.batch.values)
        support = np.tile(np.arange(DICTIONARY.size), (len(self.data), 1))[None]
        fit = replace(objective.fit, support=support, coefficients=self.coefficients[None])
        objective.f, objective.multipliers = self.f[None], self.multipliers[None]
        call = objective.objective(fit)
        moved = minimize(
            lambda x: tuple(part[0] for part in call(x[None])),
            self.domain.ravel(),
            jac=True,
            method="BFGS",
            options={"gtol": 1e-8},
        ).x
        self.domain = moved.reshape(2, -1)
        h = self.fitted(self.domain)
        self.f = (2 * self.data + rho * (h - self.multipliers / rho)) / (2 + rho)
        self.multipliers = self.multipliers + tau * rho * (self.f - h)
        return float(((self.data - h) ** 2).sum() + self.regularisation(self.domain))


@pytest.mark.parametrize("zero", [True, False])
def test_follows_the_printed_steps(zero: bool) -> None:
    settings = replace(PRINTED, initial_fit="zero" if zero else "data")
    batch = batch_of(problem(side=8, seed=5))
    reference = OnePatch(batch, settings, zero=zero)
    iteration = Iteration(
        batch, DICTIONARY, settings, batch.start, np.zeros_like(batch.values) if zero else batch.values
    )
    for number in range(3):
        expected = reference.step()
        iteration.step(np.ones(1, dtype=bool))
        assert iteration.energy[0] == pytest.approx(expected, rel=0.02), f"iteration {number + 1}"
    np.testing.assert_allclose(iteration.f[0], reference.f, atol=0.05)


def test_the_first_iteration_from_zero_selects_nothing() -> None:
    batch = batch_of(problem(seed=1), problem(hill, seed=2))
    iteration = Iteration(batch, DICTIONARY, PRINTED, batch.start, np.zeros_like(batch.values))
    iteration.step(np.ones(2, dtype=bool))
    np.testing.assert_array_equal(iteration.fit.coefficients, 0.0)
    np.testing.assert_allclose(iteration.domain, batch.start, atol=1e-12)
    np.testing.assert_allclose(iteration.f, 2 * batch.values / 2.1)


def test_keeps_the_best_iterate_of_every_problem() -> None:
    batch = batch_of(*(problem(crease if seed % 2 else hill, seed=seed) for seed in range(6)))
    solution = paper_method.solve(batch, DICTIONARY, PRINTED)
    energies = np.array(solution.trace.energy)
    assert energies.shape == (15, 6)
    fitted = DICTIONARY.sparse_values(
        solution.support, solution.coefficients, batch.observed(solution.domain)[:, :, None]
    )
    flat = solution.domain.reshape(2, -1)
    regularisation = 0.2 * batch.by_problem(batch.energy.proximity(flat)).sum(axis=1)
    regularisation += 0.1 * batch.by_problem(batch.energy.rigidity(batch.energy.jacobian(flat))).sum(axis=1)
    kept = (((fitted - batch.values) * batch.root_weights) ** 2).sum(axis=(1, 2)) + regularisation
    np.testing.assert_allclose(kept, energies.min(axis=0), rtol=1e-9)
    assert (energies.argmin(axis=0) < 14).any()  # as printed the last iterate is not the best


def test_with_rho_one_and_f_from_the_data_it_settles_where_the_printed_one_does_not() -> None:
    problems = [problem(seed=seed) for seed in range(8)]
    printed, converging = (
        np.array(paper_method.solve(batch_of(*problems), DICTIONARY, settings).trace.energy).sum(axis=1)
        for settings in (PRINTED, CONVERGING)
    )
    assert printed[-1] > 1.1 * printed.min()
    assert converging[-1] < 1.1 * converging.min()
    assert converging.min() < 0.75 * printed.min()


def test_problems_of_a_batch_do_not_see_each_other() -> None:
    problems = [problem(seed=1, side=9), problem(hill, seed=2, side=12), problem(seed=3, side=11)]
    settings = replace(CONVERGING, iterations=4)
    together = paper_method.solve(batch_of(*problems), DICTIONARY, settings)
    for k, one in enumerate(problems):
        alone = paper_method.solve(batch_of(one), DICTIONARY, settings)
        energies = [np.array(s.trace.energy)[:, c] for s, c in ((alone, 0), (together, k))]
        np.testing.assert_allclose(*energies, rtol=1e-3)


def test_a_problem_stops_when_nothing_changes() -> None:
    flat = problem(lambda u, v: 0.3 * u - 0.1 * v, seed=4)
    solution = paper_method.solve(batch_of(flat), DICTIONARY, CONVERGING)
    energies = np.array(solution.trace.energy)[:, 0]
    assert energies.shape == (15,)
    np.testing.assert_array_equal(energies[3:], energies[3])
    assert solution.trace.squared_error[-1][0] < 1e-12


def test_scale_and_place_do_not_matter() -> None:
    settings = replace(PRINTED, iterations=4)
    one, other = (
        paper_method.solve(batch_of(problem(seed=6, scale=scale)), DICTIONARY, settings) for scale in (1.0, 37.0)
    )
    np.testing.assert_allclose(np.array(one.trace.energy), np.array(other.trace.energy), rtol=1e-6)


def test_observations_without_weight_do_not_count() -> None:
    whole = problem(seed=7)
    rng = np.random.default_rng(0)
    weights = (rng.random(len(whole.values)) > 0.2).astype(float)
    spoiled = np.where(weights[:, None] > 0, whole.values, 50.0)
    settings = replace(CONVERGING, iterations=3)
    one = paper_method.solve(batch_of(replace(whole, weights=weights)), DICTIONARY, settings)
    other = paper_method.solve(batch_of(replace(whole, weights=weights, values=spoiled)), DICTIONARY, settings)
    np.testing.assert_allclose(one.domain, other.domain, atol=1e-12)
    np.testing.assert_allclose(one.coefficients, other.coefficients, rtol=1e-9, atol=1e-12)


def test_improving_never_raises_the_energy() -> None:
    batch = batch_of(*(problem(seed=seed) for seed in range(4)))
    before = paper_method.solve(batch, DICTIONARY, replace(CONVERGING, iterations=3))
    after = paper_method.improve(batch, DICTIONARY, PRINTED, before.domain, before.support, 2)
    restarted = Iteration(batch, DICTIONARY, PRINTED, before.domain, batch.values)
    start = paper_method.improve(batch, DICTIONARY, PRINTED, before.domain, before.support, 0)
    ends = []
    for solution in (start, after):
        restarted.domain = solution.domain
        fit = replace(restarted.fit, support=solution.support, coefficients=solution.coefficients)
        residual = restarted.residual(fit)
        ends.append((residual**2).sum(axis=(1, 2)) + restarted.objective(fit).regularisation(solution.domain)[0])
    assert (ends[1] <= ends[0] * (1 + 1e-12)).all()


def test_no_iterations_is_the_sparse_fit_over_the_initial_domain() -> None:
    batch = batch_of(problem(seed=1))
    solution = paper_method.solve(batch, DICTIONARY, replace(PRINTED, iterations=0))
    np.testing.assert_array_equal(solution.domain, batch.start)
    assert len(solution.trace.energy) == 1


# ---------------------------------------------------------------------------------------------------- whole surfaces


def surface_rms(settings: Settings) -> float:
    return float(approximate(*cube(), settings).report["relative"]["surface_rms"])


@pytest.fixture(scope="module")
def traditional_rms() -> float:
    return surface_rms(Settings(method="traditional", sweeps=0))


def test_is_no_worse_than_the_traditional_fit_as_printed(traditional_rms: float) -> None:
    assert surface_rms(replace(PRINTED, sweeps=0)) <= traditional_rms


def test_is_far_better_than_the_traditional_fit_at_its_best(traditional_rms: float) -> None:
    assert surface_rms(replace(CONVERGING, sweeps=0)) <= traditional_rms / 1.5


def test_readings_are_settings_that_change_the_result() -> None:
    readings: list[dict] = [
        {},
        {"initial_fit": "data"},
        {"regularisation": "vertex"},
        {"rigidity_reference": "previous"},
        {"observations": "centroids"},
        {"domains": "separate"},
        {"rho": 1.0},
        {"tau": 0.3},
    ]
    results = [approximate(*cube(6), replace(PRINTED, ring=4, iterations=4, sweeps=0, **r)).vertices for r in readings]
    for k, one in enumerate(results):
        assert all(np.abs(one - other).max() > 1e-6 for other in results[:k]), readings[k]


def test_flips_are_counted_where_nothing_holds_the_domain() -> None:
    free = approximate(*cube(8), replace(CONVERGING, beta1=0.0, beta2=0.0, sweeps=0, observations="vertices"))
    held = approximate(*cube(8), replace(CONVERGING, sweeps=0))
    assert free.report["flipped_triangles"] >= 5
    assert held.report["flipped_triangles"] == 0


def test_iterations_are_reported_and_kept_on_request() -> None:
    settings = replace(CONVERGING, iterations=5, sweeps=1, keep_iterations=True)
    result = approximate(*cube(8), settings)
    history, report = result.history, result.report
    assert history is not None
    assert history.shape == (5, len(result.vertices), 3)
    assert len(report["energy"]) == len(report["iterations"]["patch_rms"]) == 5
    assert report["iterations"]["energy"] == report["energy"]
    errors = np.linalg.norm(history - cube(8)[0], axis=2)
    assert np.sqrt((errors[-1] ** 2).mean()) < np.sqrt((errors[0] ** 2).mean())
    assert approximate(*cube(8), replace(settings, keep_iterations=False)).history is None

"""Steps of the kernel against dense linear algebra and finite differences."""

from __future__ import annotations

import ctypes
from ctypes import byref
from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
from numpy.polynomial import legendre
from sparse_surface.solver.arrays import Array, Indices
from sparse_surface.solver.fitting.batch import Problem, WarmStart, frame_of
from sparse_surface.solver.fitting.chunks import ChunkTask
from sparse_surface.solver.fitting.dictionary import Dictionary
from sparse_surface.solver.fitting.native_chunks import Prepared, fit_natively, native_settings
from sparse_surface.solver.native.library import function
from sparse_surface.solver.settings import Settings
from synthetic import crease, problem

SETTINGS = Settings(degree=6, sparsity=5, beta1=0.3, beta2=0.2).resolved()
DEGREES = Dictionary(6, "legendre").degrees
SUPPORT = np.array([[0, 1, 2, 4, 12], [0, 1, 2, 3, 5], [0, 3, 4, 7, 26]])


class Examination(ctypes.Structure):
    """`Examination` of examine.c."""

    _fields_ = tuple((name, ctypes.c_void_p) for name in ("gram", "correlation", "energy", "force", "move"))


class Examined:
    """What the kernel computes of a problem at a domain (m, 2) in its frame."""

    def __init__(
        self, given: Problem, domain: Array, support: Indices, instructions: str, settings: Settings = SETTINGS
    ) -> None:
        warm = replace(given, warm=WarmStart(frame_of(given), domain, support))
        prepared = Prepared.of([warm], settings)
        size = len(DEGREES)
        self.gram, self.correlation = np.empty((size, size)), np.empty((3, size))
        self.energy, self.force, self.move = np.empty(1), np.empty((2, len(domain))), np.empty((2, len(domain)))
        out = Examination(*(array.ctypes.data for array in vars(self).values()))
        asked = native_settings(settings)
        assert function("examine", instructions)(prepared.address, byref(asked), byref(out)) == 0


def given_problem() -> Problem:
    plain = problem(crease, side=5, seed=2, inside=True, degree=6)
    return replace(plain, weights=plain.weights * np.random.default_rng(1).uniform(0.2, 1.0, len(plain.weights)))


def domain_of(given: Problem) -> Array:
    """Return a domain somewhat away from the initial one."""
    start = frame_of(given).put_in(given.domain)
    return start + np.random.default_rng(5).normal(0.0, 0.03, start.shape)


def observed(given: Problem, domain: Array) -> Array:
    return np.einsum("nk,nkd->nd", given.shares, domain[given.corners])


def weighted_functions(given: Problem, domain: Array) -> Array:
    """Return the weighted dictionary (n, N), by NumPy's Legendre polynomials."""
    u, v = observed(given, domain).T / 1.05
    values = legendre.legvander2d(u, v, [6, 6]).reshape(-1, 7, 7)
    return np.array([values[:, i, j] for i, j in DEGREES]) * np.sqrt(given.weights)


def weighted_values(given: Problem) -> Array:
    frame = frame_of(given)
    return ((given.values - frame.origin) * frame.scale).T * np.sqrt(given.weights)


def jacobians(given: Problem, domain: Array) -> tuple[Array, Array]:
    """Return the domain transformation's Jacobians (t, 2, 2) and the initial areas, from edges."""
    start = frame_of(given).put_in(given.domain)
    before, after = (x[given.triangles[:, 1:]] - x[given.triangles[:, :1]] for x in (start, domain))
    maps = np.swapaxes(after, 1, 2) @ np.linalg.inv(np.swapaxes(before, 1, 2))
    return maps, np.abs(np.linalg.det(before)) / 2.0


def energy(given: Problem, domain: Array, settings: Settings = SETTINGS) -> float:
    """Eq. 3 with the best coefficients, by least squares and singular values."""
    functions, values = weighted_functions(given, domain), weighted_values(given)
    total = 0.0
    for signal, chosen in zip(values, SUPPORT, strict=True):
        solution = np.linalg.lstsq(functions[chosen].T, signal, rcond=None)[0]
        total += ((signal - solution @ functions[chosen]) ** 2).sum()
    maps, area = jacobians(given, domain)
    stretches = np.linalg.svd(maps, compute_uv=False)
    stretches[:, 1] *= np.sign(np.linalg.det(maps))
    start = frame_of(given).put_in(given.domain)
    rigidity = (area * ((stretches - 1.0) ** 2).sum(axis=1)).sum()
    return float(total + settings.beta1 * ((domain - start) ** 2).sum() + settings.beta2 * rigidity)


def test_gram_matrix_and_correlations_are_the_sums_over_observations(instructions: str) -> None:
    given = given_problem()
    domain = domain_of(given)
    examined = Examined(given, domain, SUPPORT, instructions)
    functions = weighted_functions(given, domain)
    np.testing.assert_allclose(examined.gram, functions @ functions.T, atol=1e-12)
    np.testing.assert_allclose(examined.correlation, weighted_values(given) @ functions.T, atol=1e-12)


def test_the_energy_is_that_of_equation_3(instructions: str) -> None:
    given = given_problem()
    domain = domain_of(given)
    assert Examined(given, domain, SUPPORT, instructions).energy[0] == pytest.approx(energy(given, domain), rel=1e-8)


def test_the_force_is_minus_half_the_gradient_of_the_energy(instructions: str) -> None:
    given = given_problem()
    domain = domain_of(given)
    gradient = scipy.optimize.approx_fprime(domain.ravel(), lambda x: energy(given, x.reshape(domain.shape)), 1e-7)
    force = Examined(given, domain, SUPPORT, instructions).force.T.ravel()
    np.testing.assert_allclose(force, -0.5 * gradient, atol=1e-5 * np.abs(gradient).max())


def test_the_move_solves_the_gauss_newton_system(instructions: str) -> None:
    """Kaufman's system, put together densely; a few conjugate-gradient steps come close to its solution."""
    given = given_problem()
    domain = domain_of(given)
    examined = Examined(given, domain, SUPPORT, instructions)
    count = len(domain)
    functions, values = weighted_functions(given, domain), weighted_values(given)
    collect = np.zeros((len(given.values), count))
    np.add.at(collect, (np.arange(len(given.values))[:, None], given.corners), given.shares)
    system = np.zeros((2 * count, 2 * count))
    step = 1e-6
    for signal, chosen in zip(values, SUPPORT, strict=True):
        solution = np.linalg.lstsq(functions[chosen].T, signal, rcond=None)[0]
        slopes = []
        for axis in np.eye(2):
            ahead, behind = (weighted_functions(given, domain + sign * step * axis) for sign in (1.0, -1.0))
            slopes.append(solution @ (ahead - behind)[chosen] / (2.0 * step))
        moved = np.hstack([slope[:, None] * collect for slope in slopes])
        basis = np.linalg.qr(functions[chosen].T)[0]
        moved -= basis @ (basis.T @ moved)
        system += moved.T @ moved
    _, area = jacobians(given, domain)
    start = frame_of(given).put_in(given.domain)
    edges = np.swapaxes(start[given.triangles[:, 1:]] - start[given.triangles[:, :1]], 1, 2)
    hats = np.concatenate([-np.linalg.inv(edges).sum(axis=1, keepdims=True), np.linalg.inv(edges)], axis=1)
    laplacian = np.zeros((count, count))
    entries = area[:, None, None] * (hats @ np.swapaxes(hats, 1, 2))
    np.add.at(laplacian, (given.triangles[:, :, None], given.triangles[:, None, :]), entries)
    system += SETTINGS.beta1 * np.eye(2 * count) + SETTINGS.beta2 * np.kron(np.eye(2), laplacian)
    expected = np.linalg.solve(system, examined.force.ravel())
    np.testing.assert_allclose(examined.move.ravel(), expected, atol=2e-3 * np.abs(expected).max())


@pytest.mark.parametrize("seed", [1, 4, 5])
def test_a_step_uphill_is_not_taken(instructions: str, seed: int) -> None:
    """Over noise, and with little to hold the domain, a Gauss-Newton step soon leads beyond the valley."""
    plain, settings = given_problem(), replace(SETTINGS, iterations=1, beta1=1e-3, beta2=1e-3)
    noise = np.random.default_rng(seed).normal(0.0, 0.1, plain.values.shape)
    given = replace(plain, values=plain.values + noise)
    domain = frame_of(given).put_in(given.domain)
    for _ in range(20):
        before, low = domain, energy(given, domain, settings)
        move = Examined(given, domain, SUPPORT, instructions, settings).move.T
        warm = replace(given, warm=WarmStart(frame_of(given), domain, SUPPORT))
        domain = fit_natively(ChunkTask(np.arange(1), [warm], settings), instructions)[0].domain[0]
        assert energy(given, domain, settings) <= low * (1.0 + 1e-9)
        if np.array_equal(domain, before):
            break
    np.testing.assert_array_equal(domain, before)
    assert np.linalg.det(jacobians(given, before + move)[0]).min() > 0.05, "the floor does not shorten the step"
    assert 1.01 < energy(given, before + move, settings) / low < 1.5

"""Steps through domains: the compiled kernel against NumPy's own polynomials, and files that go between machines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_models import creased_terrain
from sparse_surface.solver import Representation, Settings, approximate
from sparse_surface.solver.fitting.dictionary import LEGENDRE_SUPPORT, Dictionary
from sparse_surface.solver.native.library import reason_against
from sparse_surface.solver.surface.format import domains

pytestmark = pytest.mark.skipif(reason_against() is not None, reason=str(reason_against()))


def sparse_functions(basis: str, degree: int = 9) -> tuple[domains.Functions, np.ndarray, np.ndarray]:
    """Five patches with eight functions for each coordinate; some coefficients are not used."""
    rng = np.random.default_rng(3)
    dictionary = Dictionary(degree, basis)
    support = np.stack([[rng.permutation(dictionary.size)[:8] for _ in range(3)] for _ in range(5)])
    support[1, 2, 5:] = -1
    coefficients = rng.normal(size=support.shape)
    return domains.Functions.of(dictionary, support, coefficients), support, coefficients


def damped_step(
    functions: domains.Functions,
    support: np.ndarray,
    coefficients: np.ndarray,
    basis: str,
    patch: int,
    place: np.ndarray,
    target: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Solve the damped normal equations with NumPy's own polynomials; return the step and the speeds."""
    whole = np.polynomial.Legendre.basis if basis == "legendre" else lambda k: np.polynomial.Polynomial.basis(k)
    stretch = 1.0 / LEGENDRE_SUPPORT if basis == "legendre" else 1.0
    value, jacobian = np.zeros(3), np.zeros((3, 2))
    for r in range(3):
        for number, factor in zip(support[patch, r], coefficients[patch, r], strict=True):
            if number < 0:
                continue
            along, across = (whole(int(own)) for own in functions.dictionary.degrees[number])
            u, v = stretch * place[0], stretch * place[1]
            value[r] += factor * along(u) * across(v)
            jacobian[r] += factor * stretch * np.array([along.deriv()(u) * across(v), along(u) * across.deriv()(v)])
    normal = jacobian.T @ jacobian
    damped = normal + 1e-3 * np.trace(normal) * np.eye(2)
    return np.linalg.solve(damped, jacobian.T @ (target - value)), np.linalg.norm(jacobian, axis=0)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("basis", ["legendre", "monomial"])
def test_steps_solve_the_damped_normal_equations(basis: str, compiled: bool) -> None:
    functions, support, coefficients = sparse_functions(basis)
    functions = functions if compiled else replace(functions, compiled=None)
    rng = np.random.default_rng(4)
    patch, place = rng.integers(0, 5, 80), rng.uniform(-1.0, 1.0, (80, 2))
    values = functions(patch, place)[0].T
    target = values + rng.normal(size=(80, 3)) * rng.choice([0.01, 1.0], 80)[:, None]
    found, speed = functions.nearer(patch, place, target)
    seconds = 0
    for n, k in enumerate(patch):
        given = functions, support, coefficients, basis, int(k)
        step, expected = damped_step(*given, place[n], target[n])
        at = place[n] + np.clip(step, -0.1, 0.1)
        if np.abs(at - place[n]).max() > 0.02:
            step, expected = damped_step(*given, at, target[n])
            at, seconds = at + np.clip(step, -0.1, 0.1), seconds + 1
        np.testing.assert_allclose(speed[n], expected, rtol=1e-10)
        np.testing.assert_allclose(found[n], at, rtol=1e-8)
    assert 10 < seconds < 70


@pytest.mark.parametrize("compiled", [True, False])
def test_what_overflows_is_not_walked_to(compiled: bool) -> None:
    functions, _, _ = sparse_functions("legendre")
    huge = domains.Functions.of(functions.dictionary, np.zeros((1, 3, 1), dtype=int) + 4, np.full((1, 3, 1), 1e200))
    huge = huge if compiled else replace(huge, compiled=None)
    place = np.array([[0.3, -0.2]])
    np.testing.assert_array_equal(huge.nearer(np.array([0]), place, np.zeros((1, 3)))[0], place)


def test_a_compact_file_is_the_same_surface_with_and_without_the_kernel(monkeypatch) -> None:
    surface = approximate(*creased_terrain(1500), Settings(ring=4, degree=8, sparsity=8, iterations=3)).representation
    made = {"kernel": surface.compact}
    read = {("kernel", "kernel"): Representation.from_bytes(made["kernel"])}
    monkeypatch.setattr(domains, "reason_against", lambda: "Not here.")
    made["numpy"] = Representation.from_bytes(surface.stored).compact
    read["kernel", "numpy"] = Representation.from_bytes(made["kernel"])
    monkeypatch.undo()
    read["numpy", "kernel"] = Representation.from_bytes(made["numpy"])
    first = read.pop(("kernel", "kernel"))
    for other in read.values():
        np.testing.assert_array_equal(other.triangles, first.triangles)
    np.testing.assert_allclose(read["kernel", "numpy"].domains, first.domains, atol=1e-11)
    assert abs(len(made["numpy"]) - len(made["kernel"])) < 0.001 * len(made["kernel"])

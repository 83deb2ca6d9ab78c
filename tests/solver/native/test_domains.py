"""Steps through domains: the compiled kernel against NumPy's own polynomials, and files that go between machines."""

from __future__ import annotations

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


@pytest.mark.parametrize("basis", ["legendre", "monomial"])
def test_a_step_solves_the_damped_normal_equations(basis: str) -> None:
    functions, support, coefficients = sparse_functions(basis)
    rng = np.random.default_rng(4)
    patch, place = rng.integers(0, 5, 40), rng.uniform(-1.0, 1.0, (40, 2))
    target = rng.normal(size=(40, 3))
    step, speed = functions.steps_towards(patch, place, target)
    whole = np.polynomial.Legendre.basis if basis == "legendre" else lambda k: np.polynomial.Polynomial.basis(k)
    stretch = 1.0 / LEGENDRE_SUPPORT if basis == "legendre" else 1.0
    for n, k in enumerate(patch):
        value, jacobian = np.zeros(3), np.zeros((3, 2))
        for r in range(3):
            for number, factor in zip(support[k, r], coefficients[k, r], strict=True):
                if number < 0:
                    continue
                along, across = (whole(int(own)) for own in functions.dictionary.degrees[number])
                u, v = stretch * place[n]
                value[r] += factor * along(u) * across(v)
                jacobian[r] += factor * stretch * np.array([along.deriv()(u) * across(v), along(u) * across.deriv()(v)])
        normal = jacobian.T @ jacobian
        damped = normal + 1e-3 * np.trace(normal) * np.eye(2)
        np.testing.assert_allclose(speed[n], np.linalg.norm(jacobian, axis=0), rtol=1e-10)
        np.testing.assert_allclose(step[n], np.linalg.solve(damped, jacobian.T @ (target[n] - value)), rtol=1e-8)


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

"""Sparse representation over fixed domains against scikit-learn, and its sweeps against eq. 6."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from sklearn.linear_model import orthogonal_mp
from sparse_surface.benchmarks.generated_models import cube, cubetorus, cylinder
from sparse_surface.solver import Settings, approximate
from sparse_surface.solver.fitting.batch import Problem, build_batch
from sparse_surface.solver.fitting.chunks import chunk_task
from sparse_surface.solver.fitting.dictionary import Dictionary
from sparse_surface.solver.fitting.methods import fixed_domain as traditional
from sparse_surface.solver.mesh.triangle_mesh import build_mesh
from sparse_surface.solver.patches.blending import blending_weights
from sparse_surface.solver.patches.cover import build_cover
from sparse_surface.solver.patches.observations import MeshObservations
from sparse_surface.solver.patches.parameterisation import initial_domains
from sparse_surface.solver.patches.patches import build_patches
from synthetic import problem

SETTINGS = Settings(method="traditional").resolved()


def problems_of(model: tuple, settings: Settings) -> list[Problem]:
    """Return the problems of all patches of a model."""
    mesh = build_mesh(*model, None)
    patches = build_patches(mesh, build_cover(mesh, settings.ring), settings.ring)
    weights = blending_weights(mesh, patches, settings.blending)
    observations = MeshObservations(
        mesh, patches, weights, settings.blending, None, settings.observations != "vertices"
    )
    domains = initial_domains(mesh, patches, settings.initial_domain)
    return chunk_task(observations, domains, settings, np.arange(len(patches))).problems


def test_agrees_with_scikit_learn_on_100_random_patches() -> None:
    problems = [p for model in (cube, cubetorus, cylinder) for p in problems_of(model(), SETTINGS)]
    chosen = np.random.default_rng(0).choice(len(problems), 100, replace=False)
    dictionary = Dictionary(14, "monomial")
    compared = 0
    for number in chosen:
        batch = build_batch([problems[number]], turn=False)
        solution = traditional.solve(batch, dictionary, SETTINGS)
        columns = dictionary.evaluate(batch.start[:, 0]).T
        norm = np.linalg.norm(columns, axis=0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # it stops where nothing but rounding is left to fit
            expected = orthogonal_mp(columns / norm, batch.values[0].T, n_nonzero_coefs=15, precompute=True)
        for signal, values in enumerate(batch.values[0]):
            support = np.flatnonzero(expected[:, signal])
            found = columns[:, solution.support[0, signal]] @ solution.coefficients[0, signal]
            np.testing.assert_allclose(found, columns @ (expected[:, signal] / norm), atol=1e-6)
            # On flat parts a few functions are exact; what follows them is chosen for rounding errors.
            if np.linalg.norm(found - values) > 1e-6:
                assert set(solution.support[0, signal]) == set(support), f"patch {number}, signal {signal}"
                compared += 1
    assert compared > 200


def test_leaves_the_domain_as_it_is_and_uses_no_more_functions_than_allowed() -> None:
    result = approximate(*cube(8), replace(SETTINGS, sparsity=9, sweeps=1))
    surface = result.representation
    np.testing.assert_array_equal(surface.domains, surface.initial_domains)
    assert surface.support.shape[2] == 9
    assert result.report["flipped_triangles"] == 0
    assert result.report["method"] == "traditional"
    assert len(result.report["energy"]) == 1


def test_refitting_to_other_data_is_never_worse_than_keeping_the_functions() -> None:
    first, other = problem(seed=1), problem(seed=1)
    changed = replace(other, values=other.values + 0.05 * np.sin(9.0 * other.values[:, [1, 2, 0]]))
    dictionary = Dictionary(14, "monomial")
    before = traditional.solve(build_batch([first], turn=False), dictionary, SETTINGS)
    batch = build_batch([changed], turn=False)
    after = traditional.improve(batch, dictionary, SETTINGS, before.domain, before.support, 1)
    functions = dictionary.evaluate(batch.start[:, 0])
    kept = [
        np.linalg.lstsq(functions[support].T, batch.values[0, signal], rcond=None)[1][0]
        for signal, support in enumerate(before.support[0])
    ]
    fitted = dictionary.sparse_values(after.support, after.coefficients, batch.start[:, :, None])
    assert ((fitted - batch.values) ** 2).sum() <= sum(kept) * (1 + 1e-6)


def objective_of_eq_6(sweeps: int) -> float:
    """Return the sum over the vertices of |b - mean of the patches|^2."""
    result = approximate(*cube(), replace(SETTINGS, sweeps=sweeps))
    vertices = cube()[0]
    return float(((result.vertices - vertices) ** 2).sum())


def test_sweeps_lower_the_objective_of_eq_6() -> None:
    values = [objective_of_eq_6(sweeps) for sweeps in (0, 1, 2)]
    assert values[1] < 0.9 * values[0]
    assert values[2] <= values[1] * (1 + 1e-9)


@pytest.mark.parametrize("pursuit", ["omp", "ols"])
def test_the_orthogonal_pursuit_may_be_chosen(pursuit: str) -> None:
    batch = build_batch([problem(seed=2)], turn=False)
    solution = traditional.solve(batch, Dictionary(14, "monomial"), replace(SETTINGS, pursuit=pursuit))
    assert solution.trace.energy[0][0] < 0.05 * (batch.values**2).sum()

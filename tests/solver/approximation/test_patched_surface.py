"""The surface under construction: what each method changes, and what it leaves alone."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.special import eval_legendre
from sparse_surface.benchmarks.generated_models import cube
from sparse_surface.solver import FINISH, Settings, run_to_end
from sparse_surface.solver.approximation import patched_surface as module
from sparse_surface.solver.approximation.patched_surface import PatchedSurface
from sparse_surface.solver.approximation.runner import ChunkRunner
from sparse_surface.solver.fitting.chunks import PatchFit
from sparse_surface.solver.mesh.triangle_mesh import build_mesh
from sparse_surface.solver.patches.observations import MeshObservations

MESH = build_mesh(*cube(8))
SETTINGS = Settings(ring=6, degree=4, sparsity=6, iterations=1).resolved()


def covered() -> PatchedSurface[MeshObservations]:
    def observe(patches, blending):
        return MeshObservations(MESH, patches, blending, "partition")

    return PatchedSurface.covering(MESH, observe, SETTINGS, ChunkRunner())


@pytest.fixture
def surface() -> PatchedSurface[MeshObservations]:
    made = covered()
    assert run_to_end(made.fit()) is False
    return made


def by_scipy(fit: PatchFit, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A patch's surface at parameters in its frame, (N, 3), by SciPy's Legendre polynomials."""
    degrees = [(total - j, j) for total in range(SETTINGS.degree + 1) for j in range(total + 1)]
    functions = np.array([eval_legendre(i, u / 1.05) * eval_legendre(j, v / 1.05) for i, j in degrees])
    each = zip(fit.coefficients, fit.support, strict=True)
    sums = [coefficients[which >= 0] @ functions[which[which >= 0]] for coefficients, which in each]
    return np.stack(sums, axis=1) / fit.frames[0].scale + fit.frames[0].origin


def moved_domains(surface) -> np.ndarray:
    return np.array([not np.array_equal(fit.domain, fit.initial_domain) for fit in surface.fits])


def test_asked_to_finish_it_fits_the_rest_over_their_initial_domains(surface, monkeypatch) -> None:
    assert moved_domains(surface).all()
    monkeypatch.setattr(module, "chunk_patches", lambda _, which, *__: [which[[k]] for k in range(len(which))])
    hurried = covered()
    asked = (FINISH if number == 2 else None for number in itertools.count())
    assert run_to_end(hurried.fit(), lambda _: next(asked)) is True
    # the first progress comes before any patch; the third, after two
    np.testing.assert_array_equal(moved_domains(hurried), np.arange(len(surface.fits)) < 2)


def test_a_refit_changes_only_the_patches_that_were_named(surface) -> None:
    before = surface.fits
    which = np.array([0, 2])
    assert sum(surface.refit(which, surface.observations)) == 2
    changed = [new is not old for old, new in zip(before, surface.fits, strict=True)]
    assert np.flatnonzero(changed).tolist() == which.tolist()


def test_earlier_fits_are_evaluated_where_their_patches_are_observed_now(surface) -> None:
    """A patch that was observed more densely in vain keeps its first fit, with values for a sweep to begin with."""
    first, largest = surface.fits, int(np.argmax(np.diff(surface.patches.vertex_offsets)))
    dense = surface.observations.with_dense(np.arange(len(first)) == largest)
    assert sum(surface.refit(np.array([largest]), dense)) == 1
    surface.restore(first, surface.observations)
    for k, (fit, before) in enumerate(zip(surface.fits, first, strict=True)):
        assert len(fit.values) == len(dense.of_patch(k).number)
        assert (fit is before) == (k != largest)
    fit, before, own = surface.fits[largest], first[largest], dense.of_patch(largest)
    np.testing.assert_array_equal(fit.coefficients, before.coefficients)
    vertices = int(np.diff(surface.patches.vertex_offsets)[largest])
    np.testing.assert_allclose(fit.values[:vertices], before.values[:vertices], atol=1e-12)
    u, v = np.einsum("nk,nkd->dn", own.shares, fit.domain[0][own.corners])
    np.testing.assert_allclose(fit.values, by_scipy(fit, u, v), atol=1e-12)


def test_an_oscillation_test_sees_each_refit_before_it_decides_again(surface) -> None:
    largest = int(np.argmax(np.diff(surface.patches.vertex_offsets)))
    first = surface.fits[largest]
    seen = []

    def test(of):
        which = np.arange(len(of.patches)) == largest
        for _ in range(2):
            yield which, of.observations.with_dense(which)
            seen.append(of.fits[largest])

    assert sum(surface.refit_oscillating(test)) == 2
    assert len({id(fit) for fit in [first, *seen]}) == 3
    assert len(seen[0].values) > len(first.values), "observed more densely"


def test_what_is_laid_over_changes_nothing_outside(surface) -> None:
    before, count = surface.representation().at_vertices(), len(surface.patches)
    triangles = np.zeros(len(MESH.triangles), dtype=bool)
    triangles[:2] = True
    new = run_to_end(surface.lay_over(triangles, 2, 1, SETTINGS))
    assert len(surface.patches) == count + len(new) == len(surface.fits)
    np.testing.assert_allclose(np.bincount(surface.patches.vertices, weights=surface.blending), 1.0)
    outside = np.setdiff1d(np.arange(len(MESH.vertices)), new.vertices)
    after = surface.representation().at_vertices()
    np.testing.assert_allclose(after[outside], before[outside], atol=1e-12)
    assert np.abs(after - before)[MESH.triangles[0]].max() > 1e-6


def test_vertices_that_pass_through_are_those_of_the_input(surface) -> None:
    vertices = np.zeros(len(MESH.vertices), dtype=bool)
    vertices[5:15] = True
    assert np.linalg.norm(surface.representation().at_vertices() - MESH.vertices, axis=1)[vertices].max() > 1e-6
    surface.pass_through(vertices)
    np.testing.assert_allclose(surface.representation().at_vertices()[vertices], MESH.vertices[vertices], atol=1e-12)


def test_selected_patches_keep_their_domains_and_fits(surface) -> None:
    fits, which = surface.fits, np.array([1, 3])
    domains = [surface.domains[surface.patches.vertex_patch == k] for k in which]
    surface.select(which)
    assert [fit is fits[k] for fit, k in zip(surface.fits, which, strict=True)] == [True, True]
    np.testing.assert_array_equal(surface.domains, np.concatenate(domains))


def test_other_observations_are_evaluated_and_not_fitted(surface) -> None:
    """At denser observations, which begin with the same vertices, values are those of the patches themselves."""
    coefficients = [fit.coefficients for fit in surface.fits]
    surface.observe(surface.observations.with_dense(np.ones(len(surface.patches), dtype=bool)))
    offsets = surface.patches.vertex_offsets
    own = surface.representation().at_patch_vertices
    for k, fit in enumerate(surface.fits):
        assert fit.coefficients is coefficients[k]
        size = offsets[k + 1] - offsets[k]
        np.testing.assert_allclose(fit.values[:size], own[offsets[k] : offsets[k + 1]], atol=1e-12)

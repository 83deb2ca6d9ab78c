"""What the compiled kernel gathers of a mesh, against the arrays that NumPy puts together a patch at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_models import cube, cylinder
from sparse_surface.solver.approximation.approximate import approximate
from sparse_surface.solver.approximation.patched_surface import cover
from sparse_surface.solver.approximation.sweeps import ANTI_DRIFT, against_remainder
from sparse_surface.solver.fitting.batch import Problem
from sparse_surface.solver.fitting.chunks import chunk_task, problems_of
from sparse_surface.solver.fitting.gathered import MeshTask, Remainder, joined_values
from sparse_surface.solver.fitting.native_chunks import fit_natively
from sparse_surface.solver.mesh.potential_creases import dihedrals
from sparse_surface.solver.mesh.triangle_mesh import TriangleMesh, build_mesh, cut_along
from sparse_surface.solver.native.observations import Blend
from sparse_surface.solver.patches.blending import blending_weights
from sparse_surface.solver.patches.observations import MeshObservations
from sparse_surface.solver.patches.splitting import with_domains
from sparse_surface.solver.settings import Settings

CASES = {
    "defaults": {},
    "uniform blending": {"kind": "uniform"},
    "vertices alone": {"inside": False},
    "weighted vertices": {"weighted": True},
    "small patches": {"ring": 1, "degree": 14},
    "some observed densely": {"dense": True},
    "weighted, dense and uniform": {"kind": "uniform", "weighted": True, "dense": True},
    "creases": {"cut": True},
    "creases, weighted, dense and uniform": {"cut": True, "kind": "uniform", "weighted": True, "dense": True},
    "creases, vertices alone": {"cut": True, "inside": False},
    "turned triangles": {"turned": True, "cut": True, "weighted": True, "dense": True},
    "a domain for each coordinate": {"domains": "separate", "cut": True, "weighted": True, "dense": True},
}


def some_turned(triangles: np.ndarray) -> np.ndarray:
    """Triangles of which a third run the other way round."""
    which = np.random.default_rng(4).random(len(triangles)) < 1 / 3
    return np.where(which[:, None], triangles[:, [0, 2, 1]], triangles)


class Case:
    """A mesh with its patches, domains and observations."""

    def __init__(
        self,
        kind: str = "partition",
        inside: bool = True,
        weighted: bool = False,
        dense: bool = False,
        ring: int = 4,
        degree: int = 6,
        cut: bool = False,
        domains: str = "common",
        turned: bool = False,
    ) -> None:
        settings = {"ring": ring, "degree": degree, "blending": kind, "domains": domains}
        self.settings = Settings.from_dict({**settings, "iterations": 4, "workers": 1}).resolved()
        self.mesh: TriangleMesh = build_mesh(*cylinder())
        if turned:
            self.mesh = build_mesh(self.mesh.vertices, some_turned(self.mesh.triangles))
        if cut:
            self.mesh = cut_along(self.mesh, dihedrals(self.mesh) > 45.0)
        self.patches, self.domains = with_domains(self.mesh, cover(self.mesh, ring), self.settings)
        self.blending = blending_weights(self.mesh, self.patches, kind)
        rng = np.random.default_rng(3)
        weights = rng.random(len(self.mesh.vertices)) if weighted else None
        curved = self.settings.channels == 3
        self.observations = MeshObservations(self.mesh, self.patches, self.blending, kind, weights, inside, curved)
        if dense:
            self.observations = self.observations.with_dense(rng.random(len(self.patches)) < 0.5)
        self.observed = self.observations.natively(self.domains)

    def task(self, chunk: np.ndarray, remainder: Remainder | None = None) -> MeshTask:
        degrees = np.minimum(self.settings.degree, self.observations.allowed_degrees(chunk))
        return MeshTask(chunk, self.observed, degrees, self.observations.ends_early[chunk], self.settings, remainder)


def assert_same(given: list[Problem], expected: list[Problem]) -> None:
    assert len(given) == len(expected)
    for one, other in zip(given, expected, strict=True):
        for name in ("domain", "triangles", "signals", "corners", "shares"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
        for name in ("values", "weights"):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-13, atol=1e-15, err_msg=name)
        assert (one.degree, one.noise, one.ends_early) == (other.degree, other.noise, other.ends_early)


@pytest.mark.parametrize("name", CASES)
def test_gathered_problems_are_those_of_numpy(name: str) -> None:
    case = Case(**CASES[name])  # type: ignore[arg-type]
    chunk = np.random.default_rng(0).permutation(len(case.patches))
    expected = chunk_task(case.observations, case.domains, case.settings, chunk)
    assert_same(case.task(chunk).in_full().problems, expected.problems)
    low = min(problem.degree for problem in expected.problems)
    assert low < case.settings.degree if name == "small patches" else low == case.settings.degree


@pytest.mark.parametrize("name", CASES)
def test_gathered_places_are_those_of_numpy(name: str) -> None:
    case = Case(**CASES[name])  # type: ignore[arg-type]
    chunk = np.arange(len(case.patches))[::-1]
    where = case.observed.blends(chunk)
    for k, patch in enumerate(chunk):
        own, (number, blending) = slice(*where.offsets[k : k + 2]), case.observations.blend_of(int(patch))
        np.testing.assert_array_equal(where.number[own], number)
        np.testing.assert_allclose(where.blending[own], blending, rtol=1e-13, atol=1e-16)


@pytest.mark.parametrize("cut", [False, True])
@pytest.mark.parametrize("turned", [False, True])
def test_each_observed_point_lies_where_its_shares_say(turned: bool, cut: bool) -> None:
    """However the triangles of the mesh are turned, a parameter and its point are one place."""
    case = Case(turned=turned, cut=cut, dense=True)
    assert (case.mesh.winding == 1).all() != turned
    chunk = np.arange(len(case.patches))
    for problem in [
        *case.task(chunk).in_full().problems,
        *chunk_task(case.observations, case.domains, case.settings, chunk).problems,
    ]:
        places = np.einsum("nk,nkd->nd", problem.shares, problem.signals[problem.corners])
        np.testing.assert_allclose(places, problem.values, atol=1e-12)


@pytest.mark.parametrize("name", CASES)
def test_remainders_and_blends_are_those_of_numpy(name: str) -> None:
    case, rng = Case(**CASES[name]), np.random.default_rng(1)  # type: ignore[arg-type]
    chunk = np.arange(len(case.patches))
    fits = fit_natively(case.task(chunk))
    points = case.observations.points
    blended = points + 0.01 * rng.standard_normal(points.shape)
    given = case.task(chunk, Remainder(fits, Blend(points, blended), ANTI_DRIFT)).in_full().problems
    expected, after = [], blended.copy()
    for k, fit in zip(map(int, chunk), fits, strict=True):
        own = case.observations.of_patch(k)
        alone = problems_of(case.observations, own, case.domains, case.settings, k)
        left = points[own.number] - blended[own.number] + own.blending[:, None] * fit.values
        expected += against_remainder(alone, own, left, fit, keep_balance=True)
        after[own.number] += own.blending[:, None] * (1.5 * fit.values - fit.values)
    assert_same(given, expected)
    for one, other in zip(given, expected, strict=True):
        np.testing.assert_array_equal(one.warm.support, other.warm.support)  # type: ignore[union-attr]
    moved = [replace(fit, values=1.5 * fit.values) for fit in fits]
    Blend(points, blended).exchange(case.observed.blends(chunk), joined_values(fits), joined_values(moved))
    np.testing.assert_allclose(blended, after, rtol=1e-12, atol=1e-13)
    before, fewer = blended.copy(), joined_values(fits)[:-6]
    for values in ((fewer, joined_values(moved)), (None, fewer)):
        with pytest.raises(ValueError, match="observations and values of"):
            Blend(points, blended).exchange(case.observed.blends(chunk), *values)
    with pytest.raises(ValueError, match="observations and values of"):
        Blend(points, blended).take_remainder(case.observed.gather(chunk, fitting=False), fewer, ANTI_DRIFT)
    np.testing.assert_array_equal(blended, before)


@pytest.mark.parametrize("domains", ["common", "separate"])
def test_a_task_fits_the_same_bytes_gathered_here_or_in_full(domains: str) -> None:
    case = Case(domains=domains)
    chunk = np.arange(len(case.patches))
    first = case.task(chunk)
    points = case.observations.points
    again = case.task(chunk, Remainder(fit_natively(first), Blend(points, points + 0.01), ANTI_DRIFT))
    for task in (first, again):
        for one, other in zip(fit_natively(task), fit_natively(task.in_full()), strict=True):
            for name in ("values", "initial_domain", "domain", "support", "coefficients", "energy"):
                assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


def test_whoever_looks_at_the_surface_while_it_is_solved_does_not_change_it() -> None:
    seen, results = 0, []
    for looking in (False, True):

        def report(progress) -> None:  # type: ignore[no-untyped-def]
            nonlocal seen
            if looking and progress.surface is not None:  # noqa: B023
                assert np.isfinite(progress.surface()).all()
                seen += 1

        results.append(approximate(*cube(), Settings(ring=4, iterations=3, workers=1), report=report))
    assert seen > 3
    assert results[0].vertices.tobytes() == results[1].vertices.tobytes()

"""A tolerance is kept everywhere, by finer patches where they are needed."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_models import MODELS, cube
from sparse_surface.solver import FINISH, Settings, approximate, approximate_steps, run_to_end
from sparse_surface.solver.approximation import tolerance
from sparse_surface.solver.approximation.patched_surface import cover
from sparse_surface.solver.approximation.tolerance import _across_creases
from sparse_surface.solver.mesh.potential_creases import cut_along_marked, dihedrals
from sparse_surface.solver.mesh.triangle_mesh import build_mesh
from sparse_surface.solver.surface.bounds import exceeding


def independent_error(result, vertices):
    """Largest distance at random points, not at those that the solver looks at."""
    representation = result.representation
    rng = np.random.default_rng(5)
    face = np.repeat(np.arange(len(representation.triangles)), 12)
    barycentric = rng.dirichlet(np.ones(3), size=len(face))
    flat = np.einsum("nk,nkd->nd", barycentric, vertices[representation.triangles[face]])
    return np.linalg.norm(representation.evaluate(face, barycentric) - flat, axis=1).max()


@pytest.mark.parametrize(("share", "most_reproduced"), [(0.01, 0), (0.004, 420)])
def test_the_cube_keeps_a_tolerance_between_the_measured_points_too(share, most_reproduced):
    vertices, faces = cube()
    result = approximate(vertices, faces, Settings(workers=1, tolerance=share, sweeps=0, iterations=8, creases="off"))
    kept = result.report["tolerance"]
    assert kept["achieved"] <= share
    found = max(result.report["vertex_error"]["max"], result.report["surface_error"]["max"])
    assert found <= kept["achieved"] <= 1.03 * found
    assert independent_error(result, vertices) <= share
    assert result.report["seam_max"] <= 1e-5
    assert result.report["flipped_triangles"] == 0
    assert kept["rounds"]
    assert kept["vertices_reproduced"] <= most_reproduced


def test_what_no_patch_can_do_is_reproduced_and_said():
    vertices, faces = cube(6)
    result = approximate(vertices, faces, Settings(workers=1, tolerance=2e-4, sweeps=0, iterations=4, creases="off"))
    kept = result.report["tolerance"]
    # the surface is the input wherever no patch meets it to rounding
    assert kept["achieved"] <= 1e-10
    assert kept["vertices_reproduced"] == (result.patch == -1).sum() == result.report["passed_through_vertices"] > 0


def test_a_tolerance_that_is_kept_already_costs_nothing():
    vertices, faces = MODELS["cylinder"]()
    size = np.ptp(vertices, axis=0).max()
    plain = approximate(vertices, faces, Settings(workers=1, iterations=6, sweeps=0))
    kept = approximate(vertices, faces, Settings(workers=1, iterations=6, sweeps=0, tolerance=0.2 * size))
    assert kept.report["tolerance"]["rounds"] == []
    assert kept.report["patches"] == plain.report["patches"]
    assert kept.vertices.tobytes() == plain.vertices.tobytes()


def test_rounds_use_smaller_rings_then_more_functions_and_hidden_patches_go():
    vertices, faces = cube(10)
    settings = Settings(workers=1, tolerance=3e-4, sweeps=0, iterations=4, sparsity=10, creases="off")
    plain = approximate(vertices, faces, replace(settings, tolerance=0.0))
    result = approximate(vertices, faces, settings)
    rounds = result.report["tolerance"]["rounds"]
    assert [(r["ring"], r["sparsity"]) for r in rounds] == [(4, 10), (3, 10), (2, 20), (2, 40), (1, 40)]
    functions = (result.representation.support >= 0).sum(axis=-1).max(axis=-1)
    assert functions.max() > 20 > 10 >= (plain.representation.support >= 0).sum(axis=-1).max()
    highest = np.maximum.reduceat(result.representation.weights, result.representation.vertex_offsets[:-1])
    assert highest.min() > 0.01
    laid = plain.report["patches"] + sum(r["patches"] for r in rounds)
    assert result.report["patches"] < laid, "finer patches hide coarser ones"


def test_patches_that_are_not_needed_go(monkeypatch):
    vertices, faces = MODELS["flower"]()
    settings = Settings(workers=1, tolerance=6e-4 * np.ptp(vertices, axis=0).max(), sweeps=0, iterations=6)
    result = approximate(vertices, faces, settings)

    def nothing(surface):
        yield from ()

    monkeypatch.setattr(tolerance, "_drop_needless", nothing)
    before = approximate(vertices, faces, settings)
    assert result.report["patches"] < 0.8 * before.report["patches"]
    assert result.report["passed_through_vertices"] == before.report["passed_through_vertices"]
    assert result.report["tolerance"]["rounds"] == before.report["tolerance"]["rounds"]
    assert independent_error(result, vertices) <= result.report["tolerance"]["achieved"] <= settings.tolerance
    assert not exceeding(result.representation, settings.tolerance).any()


def test_whoever_finishes_early_does_not_wait_for_patches_to_be_looked_at(monkeypatch):
    vertices, faces = cube(8)
    settings = Settings(workers=1, tolerance=3e-4, sweeps=0, iterations=4, sparsity=10, creases="off")

    def never(surface):
        raise AssertionError("looked at")
        yield

    monkeypatch.setattr(tolerance, "_drop_needless", never)
    steps = approximate_steps(vertices, faces, settings)
    result = run_to_end(steps, lambda step: FINISH if "triangles left" in step.detail else None)
    assert result.report["tolerance"]["achieved"] <= settings.tolerance
    with pytest.raises(AssertionError, match="looked at"):
        approximate(vertices, faces, settings)


def test_a_patch_has_a_part_in_its_triangles_and_across_its_creases():
    mesh = build_mesh(*cube(8))
    mesh = cut_along_marked(mesh, mesh.edges[dihedrals(mesh) > 75.0])
    surface = SimpleNamespace(mesh=mesh, patches=cover(mesh, 4))
    found = tolerance._parts(surface)
    assert len(mesh.creases)
    assert found.shape == (len(surface.patches), len(mesh.triangles))
    wider = 0
    for patch in range(len(surface.patches)):
        own = np.zeros(len(mesh.triangles), dtype=bool)
        own[surface.patches.select([patch]).mesh_triangles] = True
        expected = own | _across_creases(mesh, own)
        wider += int((expected & ~own).sum())
        assert np.array_equal(found[[patch]].toarray()[0] > 0, expected)
    assert wider
    together = tolerance._apart(found, np.arange(len(surface.patches)))
    times = (found.toarray() > 0)[together].sum(axis=0)
    assert len(together) > 1
    assert times.max() == 1
    for patch in np.setdiff1d(np.arange(len(surface.patches)), together):
        assert times[found[[patch]].indices].any(), "it could have been taken, too"


@pytest.mark.long
@pytest.mark.parametrize("share", [0.01, 0.002, 0.0005])
@pytest.mark.parametrize("model", [*sorted(MODELS), "fandisk.obj", "stanford-bunny.ply", "rocker-arm.obj"])
def test_every_model_keeps_every_tolerance(model, share, load_model):
    vertices, faces = MODELS[model]() if model in MODELS else load_model(model)
    size = np.ptp(vertices, axis=0).max()
    result = approximate(vertices, faces, Settings(tolerance=share * size))
    report = result.report
    assert max(report["relative"]["vertex_max"], report["relative"]["surface_max"]) <= share
    assert report["surface_error"]["bound"] <= share * size
    assert independent_error(result, vertices) <= share * size


def test_a_patch_changes_the_surface_across_its_creases_and_there_it_is_measured_again():
    """At a crease the surface is the mean of both sides, so a change of one side moves triangles of the other."""
    vertices, faces = cube(12)
    surface = approximate(vertices, faces, Settings(workers=1, sweeps=0, iterations=4)).representation
    mesh = replace(build_mesh(surface.vertices, surface.triangles), creases=surface.creases)
    for patch in range(0, surface.patches, 7):
        coefficients = surface.coefficients.copy()
        coefficients[patch] *= 1.5
        held = np.zeros(len(surface.triangles), dtype=bool)
        held[surface.mesh_triangles[surface.patch_of_triangle == patch]] = True
        every = np.repeat(np.arange(len(surface.triangles)), 3)
        inside = np.tile([[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]], (len(surface.triangles), 1))
        moved = replace(surface, coefficients=coefficients).evaluate(every, inside) - surface.evaluate(every, inside)
        changed = (np.abs(moved).max(axis=1) > 1e-12).reshape(-1, 3).any(axis=1)
        assert (changed & ~held).any(), "the change has to cross a crease"
        assert not (changed & ~held & ~_across_creases(mesh, held)).any()

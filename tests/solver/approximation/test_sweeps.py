"""Sweeps: colours, the problems of eq. 6, and what a pass over the patches does to the surface."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_models import cube, cylinder
from sparse_surface.solver import Settings, approximate, run_to_end
from sparse_surface.solver.approximation.patched_surface import PatchedSurface, cover
from sparse_surface.solver.approximation.runner import ChunkRunner
from sparse_surface.solver.approximation.sweeps import against_remainder, colour_patches
from sparse_surface.solver.fitting.chunks import problems_of
from sparse_surface.solver.mesh.sampling import SURFACE_SAMPLES
from sparse_surface.solver.mesh.triangle_mesh import build_mesh
from sparse_surface.solver.patches.observations import MeshObservations
from sparse_surface.solver.surface.metrics import surface_error
from sparse_surface.solver.surface.overlaps import overlap_gaps


@pytest.fixture(scope="module")
def surface():
    """A cube whose patches have been fitted."""
    mesh, settings = build_mesh(*cube(6)), Settings(iterations=2, ring=4).resolved()

    def observe(patches, blending):
        return MeshObservations(mesh, patches, blending, "partition")

    made = PatchedSurface.covering(mesh, observe, settings, ChunkRunner())
    run_to_end(made.fit())
    return made


def test_patches_of_one_colour_share_no_vertex():
    patches = cover(build_mesh(*cylinder()), 5)
    colours = colour_patches(patches)
    assert sorted(np.concatenate(colours)) == list(range(len(patches)))
    for colour in colours:
        vertices = patches.select(colour).vertices
        assert len(np.unique(vertices)) == len(vertices)


def test_the_blend_at_the_observations_is_that_of_the_representation(surface):
    count = len(surface.mesh.vertices)
    np.testing.assert_allclose(surface.blended[:count], surface.representation().at_vertices(), atol=1e-12)
    run_to_end(surface.sweep("Blending patches", ""))
    np.testing.assert_allclose(surface.blended[:count], surface.representation().at_vertices(), atol=1e-12)


@pytest.mark.parametrize(("keep_balance", "gamma"), [(True, 0.1), (False, 0.0)])
def test_problems_of_a_sweep_minimise_equation_6(surface, keep_balance, gamma):
    """For any two surfaces of the patch the objectives differ as those of the formula do."""
    observations, random = surface.observations, np.random.default_rng(3)
    own = observations.of_patch(1)
    data = observations.points[own.number]
    left = own.blending[:, None] * data + 0.01 * random.normal(size=data.shape)
    alone = problems_of(observations, own, surface.domains, surface.settings, 1)
    (problem,) = against_remainder(alone, own, left, surface.fits[1], keep_balance)

    def formula(h):
        misfit = ((left - own.blending[:, None] * h) ** 2 + gamma * (data - h) ** 2).sum(axis=1)
        return (own.weights * misfit).sum()

    def objective(h):
        return (problem.weights * ((problem.values - h) ** 2).sum(axis=1)).sum()

    weights = own.weights * (own.blending**2 + gamma)
    scale = alone[0].weights.sum() / weights.sum() if keep_balance else 1.0
    one, other = data + 0.1 * random.normal(size=(2, *data.shape))
    assert objective(one) - objective(other) == pytest.approx(scale * (formula(one) - formula(other)), rel=1e-9)
    expected = alone[0].weights.sum() if keep_balance else weights.sum()
    assert problem.weights.sum() == pytest.approx(expected)


def test_each_coordinate_with_a_domain_of_its_own_gets_its_own_target():
    mesh, settings = build_mesh(*cube(4)), Settings(iterations=1, ring=3, domains="separate").resolved()

    def observe(patches, blending):
        return MeshObservations(mesh, patches, blending, "partition")

    made = PatchedSurface.covering(mesh, observe, settings, ChunkRunner())
    run_to_end(made.fit())
    own = made.observations.of_patch(1)
    data = made.observations.points[own.number]
    left = own.blending[:, None] * data + [0.1, -0.2, 0.3]
    problems = against_remainder(
        problems_of(made.observations, own, made.domains, settings, 1), own, left, made.fits[1], True
    )
    assert len(problems) == 3
    for c, problem in enumerate(problems):
        # The minimum of phi^2 (left / phi - h)^2 + gamma (data - h)^2 over h.
        wanted = (own.blending * left[:, c] + 0.1 * data[:, c]) / (own.blending**2 + 0.1)
        np.testing.assert_allclose(problem.values, wanted[:, None], rtol=1e-12)
        np.testing.assert_array_equal(problem.warm.support, made.fits[1].support[c : c + 1])


def test_a_sweep_brings_the_blend_nearer_and_the_patches_together():
    vertices, faces = cube(8)
    alone, swept = (
        approximate(vertices, faces, Settings(workers=1, iterations=6, sweeps=n, creases="off")) for n in (0, 2)
    )
    assert swept.report["vertex_error"]["rms"] < 0.95 * alone.report["vertex_error"]["rms"]
    inside = [surface_error(result.representation, samples=SURFACE_SAMPLES) for result in (alone, swept)]
    assert np.sqrt(np.mean(inside[1] ** 2)) < 0.98 * np.sqrt(np.mean(inside[0] ** 2))
    # without the term that holds them near the data the patches drift apart to 2.4 times the gap
    assert overlap_gaps(swept.representation).mean() < 0.95 * overlap_gaps(alone.representation).mean()


def test_energies_are_those_of_the_patches_by_themselves():
    vertices, faces = cube(6)
    alone, swept = (
        approximate(vertices, faces, Settings(workers=1, iterations=4, sweeps=n, creases="off")) for n in (0, 1)
    )
    assert swept.vertices.tobytes() != alone.vertices.tobytes()
    assert swept.report["energy"] == alone.report["energy"]
    np.testing.assert_array_equal(swept.representation.energy, alone.representation.energy)

"""Patches that swing out between their observations are found and fitted again."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_models import flower, sphere
from sparse_surface.solver import Settings, approximate, run_to_end
from sparse_surface.solver.approximation.oscillation import errors_between
from sparse_surface.solver.approximation.patched_surface import PatchedSurface
from sparse_surface.solver.approximation.runner import ChunkRunner
from sparse_surface.solver.mesh.triangle_mesh import build_mesh
from sparse_surface.solver.patches.blending import blending_weights
from sparse_surface.solver.patches.cover import build_cover
from sparse_surface.solver.patches.observations import MeshObservations
from sparse_surface.solver.patches.parameterisation import initial_domains
from sparse_surface.solver.patches.patches import build_patches


@pytest.mark.parametrize("domains", ["common", "separate"])
def test_the_flower_stays_near_between_vertices_and_centroids(domains):
    """With a common domain a patch swings when it is fitted, with separate ones the sweep has one swing."""
    vertices, faces = flower()
    report = approximate(vertices, faces, Settings(sweeps=1, domains=domains, creases="off")).report
    assert report["relative"]["surface_max"] < 2.0 * report["relative"]["vertex_max"]


def test_errors_between_are_those_at_dense_observations():
    mesh = build_mesh(*sphere(6))
    patches = build_patches(mesh, build_cover(mesh, 3), 3)
    weights = blending_weights(mesh, patches, "partition")
    settings = Settings(iterations=1).resolved()
    observations = MeshObservations(mesh, patches, weights, "partition").with_dense(np.ones(len(patches), dtype=bool))
    domains = initial_domains(mesh, patches)
    surface = PatchedSurface(mesh, patches, domains, lambda *_: observations, settings, ChunkRunner())
    run_to_end(surface.fit())
    found = errors_between(surface)
    assert found.max() > 0.0
    for k, fit in enumerate(surface.fits):
        own = observations.of_patch(k)
        errors = np.linalg.norm(fit.values - observations.points[own.number], axis=1) * own.blending
        inside = errors[np.diff(patches.vertex_offsets)[k] :].reshape(-1, 6)
        np.testing.assert_allclose(found[k], inside[:, 3:].max(), rtol=1e-9)

"""Patches that swing out between their observations are found and fitted again."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_models import flower, sphere
from sparse_surface.solver import Settings, approximate, run_to_end
from sparse_surface.solver.approximation.oscillation import UnevenTriangles, errors_between, with_lower_degrees
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


def test_of_all_degrees_each_patch_keeps_the_one_with_the_smallest_error():
    """Three patches whose errors at each degree are given: the second degree is best, the last one, none is needed."""
    errors = [{10: 5.0, 6: 1.0, 3: 3.0, 1: 4.0}, {10: 5.0, 6: 6.0, 3: 4.0, 1: 2.0}, {10: 0.1}]
    surface = SimpleNamespace(patches=range(3), settings=SimpleNamespace(degree=10), fits=[(k, 10) for k in range(3)])
    surface.observations = SimpleNamespace(
        degrees=np.full(3, 12), with_degrees=lambda degrees: SimpleNamespace(degrees=degrees)
    )
    kept = {}
    surface.restore = lambda fits, observations: kept.update(fits=fits, degrees=observations.degrees.tolist())
    rounds = with_lower_degrees(
        surface,
        lambda which: np.array([errors[k][surface.fits[k][1]] for k in which]),
        0.5,
        lambda patches, degrees: SimpleNamespace(degrees=degrees),
        lowest=1,
    )
    asked = []
    for oscillating, observations in rounds:
        asked.append(np.flatnonzero(oscillating).tolist())
        surface.fits = [(k, int(observations.degrees[k])) if oscillating[k] else surface.fits[k] for k in range(3)]
    assert asked == [[0, 1]] * 3
    assert kept == {"fits": [(0, 6), (1, 1), (2, 10)], "degrees": [6, 1, 10]}


def test_triangles_four_times_as_long_as_the_median_are_uneven():
    """Found one at a time, from the domains alone, on a sheet whose columns get wider towards one side."""
    columns = np.concatenate([np.arange(12.0), 11.0 + np.cumsum([3.0, 9.0, 20.0])])
    x, y = np.meshgrid(columns, np.arange(9.0), indexing="ij")
    vertices = np.stack([x, y, 0.1 * np.sin(x)], axis=-1).reshape(-1, 3)
    corner = (9 * np.arange(14)[:, None] + np.arange(8)).ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + 9, corner + 10], axis=1), np.stack([corner, corner + 10, corner + 1], axis=1)]
    )
    representation = approximate(vertices, faces, Settings(iterations=1, sweeps=0, creases="off")).representation
    expected = []
    for k in range(len(representation.triangle_offsets) - 1):
        own = slice(*representation.triangle_offsets[k : k + 2])
        corners = representation.initial_domains[0, representation.corners[own]]
        longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        weight = representation.weights[representation.corners[own]].max(axis=1)
        expected.append((longest > 4.0 * np.sort(longest)[len(longest) // 2]) & (weight > 0.0))
    found = UnevenTriangles.of(representation)
    assert 0 < sum(map(np.sum, expected)) < len(representation.corners) / 4
    assert found.patches.tolist() == [bool(each.any()) for each in expected]
    np.testing.assert_array_equal(found.mesh_triangles, representation.mesh_triangles[np.concatenate(expected)])

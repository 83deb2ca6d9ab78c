"""Points as observations of patches: each must be seen where it lies."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_clouds import ball
from sparse_surface.solver.mesh.projection import project
from sparse_surface.solver.mesh.triangle_mesh import build_mesh
from sparse_surface.solver.patches.blending import blending_weights
from sparse_surface.solver.patches.cover import build_cover
from sparse_surface.solver.patches.patches import build_patches
from sparse_surface.solver.reconstruction.observations import (
    FILLER_WEIGHT,
    SCARCE,
    CloudObservations,
    ObservedCloud,
    affordable_degrees,
    filled,
    fillers,
)


def observed(kind: str = "partition", turned: bool = False):
    cloud = ball(800, 40)
    faces = cloud.base_faces.copy()
    if turned:
        faces[::3] = faces[::3, [0, 2, 1]]
    mesh = build_mesh(cloud.base_vertices, faces)
    patches = build_patches(mesh, build_cover(mesh, 2), 2)
    points = ObservedCloud(cloud.points, project(cloud.points, mesh), np.ones(800), 0.0)
    return mesh, patches, CloudObservations(mesh, patches, blending_weights(mesh, patches, kind), kind, points)


@pytest.mark.parametrize("turned", [False, True])
def test_a_patch_sees_the_points_of_its_triangles_where_they_lie(turned: bool) -> None:
    mesh, patches, observations = observed(turned=turned)
    on_base = observations.cloud.feet.on(mesh.vertices, mesh.triangles)
    for k in range(len(patches)):
        own = observations.of_patch(k)
        vertices = mesh.vertices[patches.vertices[patches.vertex_offsets[k] : patches.vertex_offsets[k + 1]]]
        triangles = patches.mesh_triangles[patches.triangle_offsets[k] : patches.triangle_offsets[k + 1]]
        expected = np.flatnonzero(np.isin(observations.cloud.feet.triangle, triangles))
        np.testing.assert_array_equal(np.sort(own.number), expected)
        places = np.einsum("nk,nkx->nx", own.shares, vertices[own.corners])
        np.testing.assert_allclose(places, on_base[own.number], atol=1e-12)


@pytest.mark.parametrize("kind", ["partition", "uniform"])
def test_the_patches_weights_sum_to_one_at_every_point(kind: str) -> None:
    _, patches, observations = observed(kind)
    total = np.zeros(len(observations.points))
    for k in range(len(patches)):
        own = observations.of_patch(k)
        total[own.number] += own.blending
    np.testing.assert_allclose(total, 1.0)


def test_triangles_with_hardly_any_points_get_fillers() -> None:
    mesh, _, observations = observed()
    weights = np.where(observations.points[:, 2] > 0.3, 0.0, 1.0)
    cloud = observations.cloud.moved(observations.cloud.feet, weights)
    places = fillers(cloud, mesh)
    counts = np.bincount(cloud.feet.triangle, weights=weights, minlength=len(mesh.triangles))
    assert set(places.triangle) == set(np.flatnonzero(counts < SCARCE))
    more = filled(cloud, places, places.on(mesh.vertices, mesh.triangles))
    assert len(more.points) == len(more.weights) == len(more.feet.triangle) == 800 + len(places.triangle)
    assert (more.weights[800:] == FILLER_WEIGHT).all()
    np.testing.assert_allclose(more.feet.on(mesh.vertices, mesh.triangles)[800:], more.points[800:])


def test_weights_and_places_of_the_first_points_can_change() -> None:
    _, _, observations = observed()
    cloud = observations.cloud
    moved = cloud.moved(cloud.feet, np.full(10, 0.5))
    np.testing.assert_array_equal(moved.weights, np.concatenate([np.full(10, 0.5), np.ones(790)]))


@pytest.mark.parametrize("points", [3, 10, 40, 190, 1000])
def test_degrees_are_the_highest_that_the_points_afford(points: int) -> None:
    degree = int(affordable_degrees(np.array([float(points)]))[0])
    polynomials = [(t + 1) * (t + 2) // 2 for t in (degree, degree + 1)]
    assert polynomials[1] > points / 2.5
    assert polynomials[0] <= max(points / 2.5, 3)

"""Patches that swing out between their observations are found and fitted again."""

from __future__ import annotations

import numpy as np
from sparse_surface.solver import Settings, approximate
from sparse_surface.solver.models import flower
from sparse_surface.solver.observations import MeshObservations
from sparse_surface.solver.overshoot import NEAR_EDGES


def test_the_flower_stays_near_between_vertices_and_centroids():
    vertices, faces = flower()
    report = approximate(vertices, faces, Settings(sweeps=1)).report
    assert report["relative"]["surface_max"] < 2.0 * report["relative"]["vertex_max"]


def test_points_in_between_are_where_they_should_be():
    from sparse_surface.solver.blending import blending_weights
    from sparse_surface.solver.cover import build_cover
    from sparse_surface.solver.mesh import build_mesh
    from sparse_surface.solver.models import sphere
    from sparse_surface.solver.patches import build_patches

    mesh = build_mesh(*sphere(6))
    patches = build_patches(mesh, build_cover(mesh, 3), 3)
    weights = blending_weights(mesh, patches, "partition")
    dense = np.ones(len(patches), dtype=bool)
    observations = MeshObservations(mesh, patches, weights, "partition", dense=dense)
    own, (inner, points) = observations.of_patch(2), observations.between(2, NEAR_EDGES)
    count = patches.vertex_offsets[3] - patches.vertex_offsets[2]
    seen = observations.points[own.number[count:]].reshape(-1, 6, 3)
    np.testing.assert_allclose(points.reshape(-1, 3, 3), seen[:, 3:], atol=1e-12)
    np.testing.assert_allclose(inner.blending.reshape(-1, 3), own.blending[count:].reshape(-1, 6)[:, 3:], atol=1e-12)

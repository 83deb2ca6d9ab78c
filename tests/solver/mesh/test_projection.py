"""Closest points and projection along normals, against brute force and by their defining properties."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sparse_surface.benchmarks.generated_clouds import ball, box, hill
from sparse_surface.benchmarks.generated_models import sphere
from sparse_surface.solver.mesh.closest_points import closest_on_triangle, closest_points, interpolate
from sparse_surface.solver.mesh.projection import project, smoothed_normals
from sparse_surface.solver.mesh.triangle_mesh import build_mesh


def samples_on(ends: np.ndarray, steps: int = 60) -> np.ndarray:
    """Points on a triangle (3, 3), densely."""
    i, j = np.meshgrid(np.arange(steps + 1), np.arange(steps + 1))
    inside = i + j <= steps
    shares = np.column_stack([steps - i[inside] - j[inside], i[inside], j[inside]]) / steps
    return shares @ ends


@given(st.integers(0, 2**32 - 1))
def test_no_sampled_point_of_a_triangle_is_closer(seed: int) -> None:
    random = np.random.default_rng(seed)
    ends, point = random.normal(size=(3, 3)), 2.0 * random.normal(size=3)
    shares = closest_on_triangle(point[None], ends[None])[0]
    assert shares.min() >= 0.0
    assert shares.sum() == pytest.approx(1.0)
    found = np.linalg.norm(shares @ ends - point)
    dense = samples_on(ends)
    sampled = np.linalg.norm(dense - point, axis=1).min()
    longest = np.linalg.norm(ends - np.roll(ends, 1, axis=0), axis=1).max()
    assert found <= sampled + 1e-12
    assert sampled <= found + longest / 60


def test_collapsed_triangles_are_segments_and_points() -> None:
    segment = np.array([[0.0, 0, 0], [2.0, 0, 0], [1.0, 0, 0]])
    shares = closest_on_triangle(np.array([[1.5, 1.0, 0.0]]), segment[None])[0]
    np.testing.assert_allclose(shares @ segment, [1.5, 0, 0], atol=1e-12)
    point = np.ones((3, 3))
    shares = closest_on_triangle(np.zeros((1, 3)), point[None])[0]
    np.testing.assert_allclose(shares @ point, [1, 1, 1])


def test_search_agrees_with_trying_every_triangle() -> None:
    random = np.random.default_rng(3)
    # one huge triangle beside small ones: the order of the centroids is not that of the distances
    vertices = np.concatenate([random.normal(size=(60, 3)), [[-30.0, -30, 2], [30, -30, 2], [0, 40, 2]]])
    triangles = np.concatenate([random.integers(0, 60, size=(80, 3)), [[60, 61, 62]]])
    points = 2.0 * random.normal(size=(300, 3))
    feet = closest_points(points, vertices, triangles)
    found = np.linalg.norm(feet.on(vertices, triangles) - points, axis=1)
    best = np.full(len(points), np.inf)
    for triangle in triangles:
        ends = np.broadcast_to(vertices[triangle], (len(points), 3, 3))
        shares = closest_on_triangle(points, ends)
        best = np.minimum(best, np.linalg.norm((ends * shares[:, :, None]).sum(axis=1) - points, axis=1))
    np.testing.assert_allclose(found, best, atol=1e-12)


@pytest.mark.parametrize("first", [0, 1])
def test_of_two_triangles_along_an_edge_the_one_with_the_nearer_centroid_is_taken(first: int) -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 3, 0], [0.5, -1, 0]])
    triangles = np.array([[0, 1, 2], [1, 0, 3]])[[first, 1 - first]]
    feet = closest_points(np.array([[0.25, 0.0, 0.2], [0.5, 0.0, 5.0]]), vertices, triangles)
    np.testing.assert_array_equal(feet.triangle, [1 - first] * 2)
    np.testing.assert_allclose(feet.on(vertices, triangles), [[0.25, 0, 0], [0.5, 0, 0]], atol=1e-15)


def test_normals_point_out_of_a_sphere_whatever_the_winding() -> None:
    vertices, triangles = sphere(6)
    turned = triangles.copy()
    turned[::3] = turned[::3, ::-1]
    normals = smoothed_normals(build_mesh(vertices, turned))
    assert (normals * vertices).sum(axis=1).min() > 0.99


def test_projection_runs_along_the_interpolated_normals() -> None:
    cloud = ball(2000, 40)
    mesh = build_mesh(cloud.base_vertices, cloud.base_faces)
    feet = project(cloud.points, mesh)
    corners = mesh.triangles[feet.triangle]
    way = cloud.points - feet.on(mesh.vertices, mesh.triangles)
    normal = interpolate(smoothed_normals(mesh), corners, feet.barycentric)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    beside = np.linalg.norm(np.cross(way, normal), axis=1)
    assert (beside < 1e-4 * np.linalg.norm(way, axis=1) + 1e-12).all()
    assert feet.barycentric.min() >= 0.0
    np.testing.assert_allclose(feet.barycentric.sum(axis=1), 1.0)


def test_projection_gives_every_triangle_of_a_coarse_base_its_share() -> None:
    """By closest points a wedge of points above each convex edge falls on the edge itself."""
    cloud = box()
    mesh = build_mesh(cloud.base_vertices, cloud.base_faces)
    closest, projected = closest_points(cloud.points, mesh.vertices, mesh.triangles), project(cloud.points, mesh)
    on_edge = [float((feet.barycentric.min(axis=1) < 1e-9).mean()) for feet in (closest, projected)]
    assert on_edge[0] > 0.05
    assert on_edge[1] < 0.01


def test_points_beyond_an_open_border_stay_on_it() -> None:
    cloud = hill()
    mesh = build_mesh(cloud.base_vertices, cloud.base_faces)
    beyond = np.array([[0.7, 0.1, 0.0], [-0.9, -0.9, 0.1]])
    feet = project(beyond, mesh)
    found = feet.on(mesh.vertices, mesh.triangles)
    assert feet.barycentric.min() >= 0.0
    assert found[0, 0] == pytest.approx(0.5)
    np.testing.assert_allclose(found[1, :2], [-0.5, -0.5], atol=0.01)

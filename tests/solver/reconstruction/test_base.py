"""The base: what is refused, and where its vertices go."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from sparse_surface.benchmarks.generated_clouds import ball, box, hill
from sparse_surface.benchmarks.generated_models import moebius, sphere
from sparse_surface.solver.errors import InputError
from sparse_surface.solver.mesh.projection import project
from sparse_surface.solver.reconstruction.base import checked_base, drawn_to_points, refuse_distant, snapped_to_creases
from sparse_surface.solver.reconstruction.geometry import analyse


def misfit(mesh, points) -> float:
    feet = project(points, mesh)
    return float(np.sqrt(((feet.on(mesh.vertices, mesh.triangles) - points) ** 2).sum(axis=1).mean()))


def test_an_edge_of_three_triangles_is_refused() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]])
    with pytest.raises(InputError, match=r"^The base is not manifold: 1 edges belong to more than two triangles\.$"):
        checked_base(vertices, np.array([[0, 1, 2], [0, 3, 1], [0, 1, 4]]))


def test_two_parts_that_share_one_vertex_are_refused() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    with pytest.raises(InputError, match=r"^The base is not manifold: parts of it meet at single vertices\.$"):
        checked_base(vertices, np.array([[0, 1, 2], [0, 3, 4]]))


def test_a_distant_base_is_refused() -> None:
    cloud = ball()
    mesh = checked_base(cloud.base_vertices + np.array([3.0, 0.0, 0.0]), cloud.base_faces)
    with pytest.raises(InputError, match=r"^The base is far from the points: half of them are more than .* long\.$"):
        refuse_distant(cloud.points, mesh)
    refuse_distant(cloud.points, checked_base(cloud.base_vertices, cloud.base_faces))


def test_faces_are_wound_alike() -> None:
    vertices, triangles = sphere(4)
    mixed = triangles.copy()
    mixed[5:40:2] = mixed[5:40:2, ::-1]
    mesh = checked_base(vertices, mixed)
    a, b, c = (vertices[mesh.triangles[:, k]] for k in range(3))
    assert ((np.cross(b - a, c - a) * a).sum(axis=1) > 0.0).all()


def test_a_base_without_orientation_is_accepted() -> None:
    checked_base(*moebius())


def test_the_base_comes_nearer_to_the_points() -> None:
    for cloud in (ball(noise=0.005), box(), hill()):
        mesh = checked_base(cloud.base_vertices, cloud.base_faces)
        fitted = drawn_to_points(mesh, cloud.points, np.ones(len(cloud.points)))
        assert misfit(fitted, cloud.points) < 0.75 * misfit(mesh, cloud.points)


def test_flat_points_and_a_flat_base_fit_exactly() -> None:
    cloud = hill()
    flat = cloud.base_vertices * [1.0, 1.0, 0.0]
    points = cloud.points * [1.0, 1.0, 0.0] + [0.0, 0.0, 0.1]
    fitted = drawn_to_points(checked_base(flat, cloud.base_faces), points, np.ones(len(points)))
    np.testing.assert_allclose(fitted.vertices[:, 2], 0.1, atol=1e-6)


def test_vertices_without_points_move_with_their_neighbours() -> None:
    cloud = hill()
    flat = cloud.base_vertices * [1.0, 1.0, 0.0]
    points = cloud.points[cloud.points[:, 0] < 0.0] * [1.0, 1.0, 0.0] + [0.0, 0.0, 0.1]
    fitted = drawn_to_points(checked_base(flat, cloud.base_faces), points, np.ones(len(points)))
    np.testing.assert_allclose(fitted.vertices[:, 2], 0.1, atol=1e-4)


def test_points_of_no_weight_draw_nothing() -> None:
    cloud = ball()
    mesh = checked_base(cloud.base_vertices, cloud.base_faces)
    stray = np.concatenate([cloud.points, np.full((200, 3), 0.9)])
    weights = np.concatenate([np.ones(len(cloud.points)), np.zeros(200)])
    alone = drawn_to_points(mesh, cloud.points, np.ones(len(cloud.points)))
    # Both use samples of the points, and not the same ones.
    np.testing.assert_allclose(drawn_to_points(mesh, stray, weights).vertices, alone.vertices, atol=0.03)


def test_vertices_go_on_to_creases_and_nothing_folds() -> None:
    cloud = box()
    mesh = drawn_to_points(
        checked_base(cloud.base_vertices, cloud.base_faces), cloud.points, np.ones(len(cloud.points))
    )
    creases = analyse(cloud.points).creases
    snapped = snapped_to_creases(mesh, creases)
    moved = (snapped.vertices != mesh.vertices).any(axis=1)
    assert moved.sum() > 30
    assert cKDTree(creases).query(snapped.vertices[moved])[0].max() == 0.0
    normals = [
        np.cross(
            m.vertices[m.triangles[:, 1]] - m.vertices[m.triangles[:, 0]],
            m.vertices[m.triangles[:, 2]] - m.vertices[m.triangles[:, 0]],
        )
        for m in (mesh, snapped)
    ]
    assert ((normals[0] * normals[1]).sum(axis=1) > 0.0).all()
    assert misfit(snapped, cloud.points) < misfit(mesh, cloud.points)


def test_without_creases_the_base_stays() -> None:
    cloud = ball()
    mesh = checked_base(cloud.base_vertices, cloud.base_faces)
    assert snapped_to_creases(mesh, np.zeros((0, 3))) is mesh

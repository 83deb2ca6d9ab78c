"""The base: what is refused, and where its vertices go."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from sparse_surface.benchmarks.generated_clouds import ball, box, hill
from sparse_surface.benchmarks.generated_models import moebius, sphere
from sparse_surface.solver.errors import InputError
from sparse_surface.solver.mesh.projection import project
from sparse_surface.solver.reconstruction.base import (
    border_near_points,
    border_out_to_points,
    checked_base,
    drawn_to_points,
    refuse_distant,
    snapped_to_creases,
    without_folds,
)
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


def equilateral(rows: int = 5):
    """A flat base of equilateral triangles with edges of length 1, and the number of its vertex at the origin."""
    j, i = np.divmod(np.arange(rows * rows), rows)
    vertices = np.stack([i + 0.5 * j, np.sqrt(0.75) * j, np.zeros(rows * rows)], axis=1)
    corner = np.array([j_ * rows + i_ for j_ in range(rows - 1) for i_ in range(rows - 1)])
    upper = np.stack([corner + 1, corner + rows + 1, corner + rows], axis=1)
    triangles = np.concatenate([np.stack([corner, corner + 1, corner + rows], axis=1), upper])
    middle = (rows // 2) * rows + rows // 2
    return checked_base(vertices - vertices[middle], triangles), middle


@pytest.mark.parametrize(("distance", "moves"), [(0.48, True), (0.52, False)])
def test_a_vertex_moves_half_an_edge_at_most(distance: float, moves: bool) -> None:
    mesh, middle = equilateral()
    crease = np.array([[0.0, 0.0, distance]])
    expected = crease[0] if moves else mesh.vertices[middle]
    np.testing.assert_allclose(snapped_to_creases(mesh, crease).vertices[middle], expected, atol=1e-12)


@pytest.mark.parametrize(("apart", "both"), [(0.5, True), (0.4, False)])
def test_neighbours_do_not_crowd_at_one_place(apart: float, both: bool) -> None:
    """Two neighbours that each have a crease point near: the nearer moves, the other only where there is room."""
    mesh, middle = equilateral()
    creases = np.array([[0.5 - apart / 2, 0.0, 0.0], [0.5 + apart / 2 + 1e-6, 0.0, 0.0]])
    moved = snapped_to_creases(mesh, creases).vertices
    np.testing.assert_allclose(moved[middle + 1], creases[1], atol=1e-12)
    np.testing.assert_allclose(moved[middle], creases[0] if both else mesh.vertices[middle], atol=1e-12)


@pytest.mark.parametrize(("height", "moves"), [(0.28, True), (0.36, False)])
def test_no_move_turns_a_triangle_by_more_than_72_degrees(height: float, moves: bool) -> None:
    """A triangle of height 0.1 turns by atan(height / 0.1): 70.3 and 74.5 degrees."""
    mesh, middle = equilateral()
    vertices = mesh.vertices.copy()
    vertices[middle, 1] += np.sqrt(0.75) - 0.1
    flat = checked_base(vertices, mesh.triangles)
    crease = vertices[[middle]] + np.array([0.0, 0.0, height])
    expected = crease[0] if moves else vertices[middle]
    np.testing.assert_allclose(snapped_to_creases(flat, crease).vertices[middle], expected, atol=1e-12)


def test_a_fit_that_would_fold_the_base_goes_only_part_of_the_way() -> None:
    mesh, middle = equilateral()
    wanted = mesh.vertices.copy()
    wanted[middle, 0] += 2.5
    # half of the way is beyond the next vertex, a quarter is not
    np.testing.assert_allclose(without_folds(mesh, wanted).vertices[middle], [0.625, 0.0, 0.0], atol=1e-12)
    wanted[middle, 0] += 100.0
    assert without_folds(mesh, wanted) is mesh


def test_a_riser_whose_treads_are_drawn_past_each_other_does_not_turn_over() -> None:
    """Points over the lower tread rise towards the riser and those under the upper one fall, beyond each other."""
    stairs = [(-1.0, 0.0), (0.0, 0.0), (0.0, 0.1), (1.0, 0.1)]
    vertices = np.array([[x, y, z] for x, z in stairs for y in (0.0, 1.0)])
    mesh = checked_base(vertices, np.array([[2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1] for k in range(3)]))
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(0.3, 1.0, 16), np.linspace(0.0, 1.0, 16)))
    lower, upper = np.stack([-x, y, 0.2 - 0.2 * x], axis=1), np.stack([x, y, 0.2 * x - 0.1], axis=1)
    drawn = drawn_to_points(mesh, np.concatenate([lower, upper]), np.ones(2 * len(x)))
    corners = np.stack([mesh.vertices, drawn.vertices])[:, mesh.triangles]
    before, after = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    assert ((before * after).sum(axis=1) > 0.0).all()
    assert (drawn.vertices[2:4, 2] > 0.01).all()
    assert (drawn.vertices[4:6, 2] < 0.09).all()


def test_the_border_comes_back_to_the_points_and_the_inside_stays() -> None:
    mesh, _ = equilateral()
    shares = np.random.default_rng(3).dirichlet([1.0, 1.0, 1.0], (len(mesh.triangles), 300))
    points = 0.9 * np.einsum("tnk,tkd->tnd", shares, mesh.vertices[mesh.triangles]).reshape(-1, 3)
    near = border_near_points(mesh, points, 0.05)
    inside = ~np.isin(np.arange(len(mesh.vertices)), mesh.node_vertex[mesh.border])
    np.testing.assert_array_equal(near.vertices[inside], mesh.vertices[inside])
    before, after = (cKDTree(points).query(of.vertices[~inside])[0] for of in (mesh, near))
    assert before.max() > 0.1
    assert after.max() < 0.0501


def test_a_border_vertex_that_would_fold_the_base_stays() -> None:
    mesh, _ = equilateral()
    moved = border_near_points(mesh, np.array([[2.0, 1.0, 0.0]]), 0.1)
    a, b, c = (moved.vertices[mesh.triangles[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0.0).all()
    assert np.isfinite(moved.vertices).all()


def chopped_square(parts: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """A mesh of the unit square whose corner at (1, 1) is cut off."""
    grid = np.linspace(0.0, 1.0, parts + 1)
    vertices = np.column_stack([np.repeat(grid, parts + 1), np.tile(grid, parts + 1), np.zeros((parts + 1) ** 2)])
    low = np.array([k for k in range((parts + 1) * parts) if k % (parts + 1) < parts])
    across = np.stack([low + 1, low + parts + 1, low + parts + 2], axis=1)  # the last one holds the corner
    return vertices[:-1], np.concatenate([np.stack([low, low + parts + 1, low + 1], axis=1), across[:-1]])


def test_a_corner_that_was_cut_off_comes_back_and_the_rest_stays() -> None:
    mesh = checked_base(*chopped_square())
    random = np.random.default_rng(4)
    points = np.vstack([np.column_stack([random.uniform(0.0, 1.0, (2000, 2)), np.zeros(2000)]), [[1.0, 1.0, 0.0]]])
    reached = border_out_to_points(mesh, points, 0.03)
    moved = np.flatnonzero((reached.vertices != mesh.vertices).any(axis=1))
    assert len(moved) == 1
    np.testing.assert_array_equal(reached.vertices[moved], [[1.0, 1.0, 0.0]])
    sides = np.diff(reached.vertices[reached.triangles], axis=1)
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    assert area.sum() == pytest.approx(1.0, rel=1e-12)
    assert area.min() > 0.0


def test_a_point_above_the_base_or_far_beyond_a_sharp_move_changes_nothing() -> None:
    mesh = checked_base(*chopped_square())
    inside = np.vstack([mesh.vertices, [[0.5, 0.5, 0.4]]])
    np.testing.assert_array_equal(border_out_to_points(mesh, inside, 0.03).vertices, mesh.vertices)
    beyond = np.vstack([mesh.vertices, [[0.5, -0.5, 3.0]]])  # a vertex that went there would turn its triangles up
    np.testing.assert_array_equal(border_out_to_points(mesh, beyond, 0.03).vertices, mesh.vertices)

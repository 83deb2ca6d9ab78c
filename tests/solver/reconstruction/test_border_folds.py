"""Where folds of open clouds end at the border: nothing is cut off, torn, or runs on beyond the points."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.solver import CloudSettings, Settings, run_to_end
from sparse_surface.solver.interchange import CloudArrays
from sparse_surface.solver.mesh.closest_points import Footpoints
from sparse_surface.solver.mesh.triangle_mesh import build_mesh
from sparse_surface.solver.reconstruction.base import snapped_to_creases
from sparse_surface.solver.reconstruction.border_folds import split_over_folds
from sparse_surface.solver.reconstruction.evaluated import reconstruct_arrays
from sparse_surface.solver.reconstruction.geometry import analyse
from sparse_surface.solver.reconstruction.holes import border_loops, without_small_holes
from sparse_surface.solver.reconstruction.observations import ObservedCloud, held_at_border
from sparse_surface.solver.reconstruction.tangent_planes import TangentPlanes

SIDES = np.array(
    [
        [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
        [[0, 0, 0], [1, 0, 0], [0, 0, 1]],
        [[0, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[0, 1, 0], [1, 0, 0], [0, 0, 1]],
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    ],
    dtype=float,
)
"""Unit squares, a floor and walls around it: a corner and two directions each."""


def corner_of_a_room(count: int, points: int, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    side = SIDES[random.integers(0, count, points)]
    u, v = random.uniform(0.0, 1.0, (points, 2)).T[:, :, None]
    return side[:, 0] + u * side[:, 1] + v * side[:, 2]


def off_the_walls(vertices: np.ndarray, count: int) -> np.ndarray:
    away = []
    for corner, *directions in SIDES[:count]:
        within = sum(np.clip((vertices - corner) @ each, 0.0, 1.0)[:, None] * each for each in directions)
        away.append(np.linalg.norm(vertices - corner - within, axis=1))
    return np.min(away, axis=0)


@pytest.mark.parametrize(("count", "seed"), [(3, 7), (4, 2), (4, 16), (5, 9), (5, 11)])
def test_corners_at_the_ends_of_folds_are_kept(count: int, seed: int) -> None:
    """They were cut off or overshot by up to 0.08, and two of these bases had a hole."""
    arrays = CloudArrays.of_points(corner_of_a_room(count, 1500, seed), CloudSettings())
    outcome = run_to_end(reconstruct_arrays(arrays, Settings(workers=1)))
    assert outcome.report["euler"] == 1
    assert off_the_walls(outcome.vertices.astype(np.float64), count).max() < 0.03


def test_an_edge_of_the_border_that_runs_across_a_fold_is_split_on_it() -> None:
    points = corner_of_a_room(2, 4000, 5)  # y = 0 meets z = 0 along x, which ends at x = 1
    base = build_mesh([[0.5, 0.0, 0.0], [1.0, 0.3, 0.0], [1.0, 0.0, 0.3], [0.6, 0.4, 0.0]], [[0, 1, 2], [1, 0, 3]])
    split = split_over_folds(base, points, analyse(points))
    assert len(split.vertices) == 5
    assert split.vertices[4] == pytest.approx([1.0, 0.0, 0.0], abs=1e-3)
    assert sorted(map(sorted, split.triangles.tolist())) == [[0, 1, 3], [0, 1, 4], [0, 2, 4]]
    assert (np.bincount(split.triangles.ravel()) > 0).all()


def test_an_edge_that_only_runs_along_a_fold_stays() -> None:
    points = corner_of_a_room(2, 4000, 5)
    base = build_mesh([[0.2, 0.3, 0.0], [0.8, 0.3, 0.0], [0.2, 0.0, 0.0], [0.8, 0.0, 0.0]], [[0, 2, 1], [1, 2, 3]])
    assert split_over_folds(base, points, analyse(points)) is base


def test_at_the_border_vertices_go_to_the_line_on_which_a_crease_ends() -> None:
    creases = np.column_stack([np.linspace(0.0, 0.9, 19), np.zeros((19, 2))])
    sheet = np.array([[0.0, 0.0, 0.0], [0.5, 0.5, 0.0], [1.0, 0.02, 0.0], [0.5, -0.5, 0.0]])
    snapped = snapped_to_creases(build_mesh(sheet, [[0, 2, 1], [0, 3, 2]]), creases)
    np.testing.assert_allclose(snapped.vertices[2], [1.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(snapped.vertices[[0, 1, 3]], sheet[[0, 1, 3]])


def test_small_holes_are_closed_and_wide_ones_stay() -> None:
    n = 12
    vertices = np.array([[x, y, 0.0] for x in range(n + 1) for y in range(n + 1)])
    quads = np.array([[i * (n + 1) + j + k for k in (0, n + 1, n + 2, 1)] for i in range(n) for j in range(n)])
    middle = vertices[quads].mean(axis=1)[:, :2]
    gone = (np.abs(middle - 2.5) < 0.9).all(axis=1) | (np.abs(middle - 8.0) < 2.0).all(axis=1)  # one and four wide
    open_ = np.concatenate([quads[~gone][:, :3], quads[~gone][:, [0, 2, 3]]])
    closed = without_small_holes(vertices, open_, 3.0)
    assert [len(border_loops(each)) for each in (open_, closed[1])] == [3, 2]
    corners = closed[0][closed[1]]
    upwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    assert (upwards > 0.0).all()
    assert upwards.sum() / 2.0 == pytest.approx(n * n - 16.0)


def test_a_border_without_points_is_held_on_their_planes_and_stays_there() -> None:
    random = np.random.default_rng(4)
    points = np.column_stack([random.uniform(0.0, 1.0, (400, 2)), np.zeros(400)])
    mesh = build_mesh([[0.0, 0.0, 0.0], [1.4, 0.0, 0.1], [1.4, 1.0, 0.1], [0.0, 1.0, 0.0]], [[0, 1, 2], [0, 2, 3]])
    geometry = analyse(points)
    inside = points[points[:, 0] < 1.0]
    shares = np.column_stack([1.0 - inside[:, 0], inside[:, 0] - inside[:, 1], inside[:, 1]])
    below = inside[:, 1] < inside[:, 0]
    feet = Footpoints(np.zeros(below.sum(), dtype=np.int64), shares[below])
    cloud = ObservedCloud(inside[below], feet, np.ones(below.sum()), 0.0)
    held = held_at_border(cloud, mesh, TangentPlanes(points, geometry), geometry.spacing)
    added = held.points[len(cloud.points) :]
    assert held.held == len(added) > 0
    np.testing.assert_allclose(added[:, 2], 0.0, atol=1e-12)
    on_base = held.feet.on(mesh.vertices, mesh.triangles)[len(cloud.points) :]
    np.testing.assert_allclose(added[:, :2], on_base[:, :2], atol=1e-12)
    elsewhere = Footpoints(np.ones_like(held.feet.triangle), np.full_like(held.feet.barycentric, 1.0 / 3.0))
    moved = held.moved(elsewhere, np.full(len(held.points), 2.0))
    assert (moved.feet.triangle[: len(cloud.points)] == 1).all()
    assert (moved.weights[: len(cloud.points)] == 2.0).all()
    np.testing.assert_array_equal(moved.feet.barycentric[-held.held :], held.feet.barycentric[-held.held :])
    np.testing.assert_array_equal(moved.weights[-held.held :], held.weights[-held.held :])

"""Holes closed up to a width, surfaces cut off where points end, tolerances that clouds are refined towards."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
import pytest
from scipy.spatial import ConvexHull, cKDTree
from sparse_surface.solver import CloudSettings, Settings, reconstruct, run_to_end
from sparse_surface.solver.errors import InputError, SettingsError
from sparse_surface.solver.interchange import CloudArrays, CloudOutcome
from sparse_surface.solver.reconstruction.evaluated import reconstruct_arrays
from sparse_surface.solver.reconstruction.holes import border_loops, least_area, without_small_holes
from sparse_surface.solver.reconstruction.trimming import cut

QUICK = Settings(workers=1, iterations=4)


def sphere_below(height: float, count: int = 4000) -> np.ndarray:
    """Points of the unit sphere that lie below a height: above it there is a round hole."""
    points = np.random.default_rng(1).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return points[points[:, 2] < height]


def waves(u: np.ndarray) -> np.ndarray:
    return np.column_stack([u, 0.3 * np.sin(2.0 * u[:, 0])])


def sheet_with_holes() -> np.ndarray:
    """Points of a wavy square, 2 wide, with two round holes, 0.8 and 0.3 wide."""
    u = np.random.default_rng(2).uniform(-1.0, 1.0, (5000, 2))
    wide = np.linalg.norm(u - [0.4, 0.3], axis=1) > 0.4
    return waves(u[wide & (np.linalg.norm(u - [-0.5, -0.4], axis=1) > 0.15)])


def solved(points: np.ndarray, settings: Settings = QUICK, **cloud: float) -> CloudOutcome:
    return run_to_end(reconstruct_arrays(CloudArrays.of_points(points, CloudSettings(**cloud)), settings))


def test_a_hole_in_a_sphere_is_closed_by_a_smooth_cap() -> None:
    points = sphere_below(0.6)  # the hole is 1.6 wide
    assert solved(points).report["euler"] == 1
    too_narrow, closed = solved(points, close_holes=1.2), solved(points, close_holes=1.8)
    assert (too_narrow.report["euler"], too_narrow.report["input"]["holes_closed"]) == (1, 0)
    assert (closed.report["euler"], closed.report["input"]["holes_closed"]) == (2, 1)
    top = closed.vertices[closed.vertices[:, 2] > 0.62].astype(np.float64)
    # a flat lid would be at 0.6; the sphere's top is at 1
    assert len(top)
    assert top[:, 2].max() > 0.75
    assert np.abs(np.linalg.norm(top, axis=1) - 1.0).max() < 0.15


@pytest.mark.parametrize(("widest", "euler"), [(0.0, -1), (0.5, 0), (1.0, 1)])
def test_only_holes_up_to_the_width_are_closed(widest: float, euler: int) -> None:
    outcome = solved(sheet_with_holes(), close_holes=widest)
    assert outcome.report["euler"] == euler
    assert outcome.report["input"].get("holes_closed") == (euler + 1 if widest else None)  # Euler -1: both are open
    vertices = outcome.vertices.astype(np.float64)
    assert np.abs(vertices[:, 2] - waves(vertices[:, :2])[:, 2]).max() < 0.03


def folded(u: np.ndarray) -> np.ndarray:
    """A rectangle, 2 long and 1 wide, folded along its middle."""
    return np.column_stack([u[:, 0], np.maximum(u[:, 1], 0.0), np.maximum(-u[:, 1], 0.0)])


@pytest.mark.parametrize(("shape", "count", "noise", "seed"), [(folded, 1500, 0.0, 3), (waves, 4000, 0.3, 5)])
def test_an_open_surface_reaches_the_corners_of_its_cloud(
    shape: Callable[[np.ndarray], np.ndarray], count: int, noise: float, seed: int
) -> None:
    random = np.random.default_rng(seed)
    points = shape(random.uniform(-1.0, 1.0, (count, 2)))
    outcome = solved(points + noise * 2.0 / count**0.5 * random.normal(size=points.shape))
    corners = shape(np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]]))
    away = cKDTree(outcome.vertices.astype(np.float64)).query(corners)[0]
    assert away.max() < 1.5 * outcome.report["input"]["spacing"]


@pytest.mark.parametrize("height", [0.97, 0.94])
def test_a_gap_that_was_bridged_is_filled_smoothly(height: float) -> None:
    """It was a dent of a quarter of the radius, and vertices copied from the base."""
    outcome = solved(sphere_below(height, 6000))
    filled = outcome.vertices[outcome.vertices[:, 2] > height].astype(np.float64)
    assert len(filled) > 20
    assert np.abs(np.linalg.norm(filled, axis=1) - 1.0).max() < 0.03
    assert outcome.report["passed_through_vertices"] == 0


def test_a_gap_that_was_bridged_opens_when_trimmed() -> None:
    points = sphere_below(0.95)
    whole, trimmed = solved(points), solved(points, trim_distance=0.12)
    assert (whole.report["euler"], trimmed.report["euler"]) == (2, 1)
    distance = cKDTree(points).query(trimmed.vertices.astype(np.float64))[0]
    assert cKDTree(points).query(whole.vertices.astype(np.float64))[0].max() > 0.25
    assert distance.max() < 0.15


def test_sparse_places_are_cut_off_and_borders_stay() -> None:
    random = np.random.default_rng(3)
    u = random.uniform(-1.0, 1.0, (4000, 2))
    points = waves(u[(u[:, 0] < 0.0) | (random.uniform(size=4000) < 0.02)])
    whole, trimmed = solved(points), solved(points, trim_density=0.15)
    assert whole.vertices[:, 0].max() > 0.8
    assert trimmed.vertices[:, 0].max() < 0.2
    even = solved(waves(u), trim_density=0.15)
    assert even.vertices.min(axis=0)[:2] == pytest.approx([-1.0, -1.0], abs=0.06)
    assert even.vertices.max(axis=0)[:2] == pytest.approx([1.0, 1.0], abs=0.06)


def test_a_base_of_the_user_is_trimmed_too() -> None:
    points = sphere_below(0.5)
    hull = ConvexHull(np.random.default_rng(5).normal(size=(150, 3)))
    corners = hull.points / np.linalg.norm(hull.points, axis=1, keepdims=True)
    sphere = ConvexHull(corners)
    outward = [
        list(each) if np.linalg.det(corners[each]) > 0.0 else list(each[::-1]) for each in sphere.simplices.tolist()
    ]
    whole = reconstruct(points, corners, outward, QUICK)
    trimmed = reconstruct(points, corners, outward, QUICK, CloudSettings(trim_distance=0.15))
    assert (whole.report["euler"], trimmed.report["euler"]) == (2, 1)
    assert trimmed.vertices[:, 2].max() < 0.5 + 0.2 < whole.vertices[:, 2].max()


def test_what_would_leave_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="Nothing is left of the surface: trim it less"):
        solved(sphere_below(2.0, 500), trim_distance=1e-9)
    with pytest.raises(SettingsError, match="trim_density must be a number from 0 to 1"):
        CloudSettings(trim_density=2.0)


def test_a_tolerance_is_worked_towards() -> None:
    def height(u: np.ndarray) -> np.ndarray:
        return 0.08 * np.sin(9.0 * u[:, 0]) * np.cos(8.0 * u[:, 1])

    def off(outcome: CloudOutcome) -> np.ndarray:
        vertices = outcome.vertices.astype(np.float64)
        inside = np.abs(vertices[:, :2]).max(axis=1) < 0.97  # beyond the border there are no points
        return np.abs(vertices[:, 2] - height(vertices[:, :2]))[inside]

    u = np.random.default_rng(6).uniform(-1.0, 1.0, (6000, 2))
    coarse = CloudArrays.of_points(np.column_stack([u, height(u)]), CloudSettings(), base_count=30)
    before = run_to_end(reconstruct_arrays(coarse, QUICK))
    tolerance = 0.1 * float(before.point_error.max())
    after = run_to_end(reconstruct_arrays(coarse, Settings(workers=1, iterations=4, tolerance=tolerance)))
    sought = after.report["tolerance"]
    assert "tolerance" not in before.report
    assert sought["points_outside_at_first"] == pytest.approx((before.point_error > tolerance).sum(), abs=2)
    assert sought["points_outside"] <= 0.2 * sought["points_outside_at_first"]
    assert sought["points_outside"] == pytest.approx((after.point_error > tolerance).sum(), abs=2)
    assert sought["achieved"] == pytest.approx(after.point_error.max(), rel=1e-9)
    assert np.linalg.norm(after.point_error) < 0.5 * np.linalg.norm(before.point_error)
    assert np.sqrt((off(after) ** 2).mean()) < np.sqrt((off(before) ** 2).mean())
    assert off(after).max() < off(before).max()


def test_noise_is_not_followed_for_a_tolerance() -> None:
    random = np.random.default_rng(4)
    points = waves(random.uniform(-1.0, 1.0, (3000, 2)))
    points[:, 2] += 0.01 * random.normal(size=len(points))
    sought = solved(points, Settings(workers=1, iterations=4, tolerance=1e-5)).report["tolerance"]
    assert sought["points_outside_at_first"] < 0.02 * len(points)


def test_the_triangles_of_least_area_are_those_of_all_triangulations() -> None:
    border = np.random.default_rng(7).normal(size=(7, 3))

    def area(triangle: tuple[int, ...]) -> float:
        a, b, c = border[list(triangle)]
        return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a)))

    def smallest(corners: tuple[int, ...]) -> float:
        if len(corners) < 3:
            return 0.0
        first, last = corners[0], corners[-1]
        return min(
            area((first, corners[k], last)) + smallest(corners[: k + 1]) + smallest(corners[k:])
            for k in range(1, len(corners) - 1)
        )

    found = least_area(border)
    assert len(found) == 5
    assert sum(area(tuple(each)) for each in found.tolist()) == pytest.approx(smallest(tuple(range(7))))
    sides = [frozenset(pair) for each in found.tolist() for pair in combinations(each, 2)]
    assert {side for side in sides if sides.count(side) == 1} == {frozenset((k, (k + 1) % 7)) for k in range(7)}


def test_borders_are_followed_all_around() -> None:
    grid = np.arange(25).reshape(5, 5)
    corners = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=2).reshape(-1, 4)
    corners = np.delete(corners, 5, axis=0)  # one square out of the middle
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    loops = sorted(border_loops(triangles), key=len)
    assert [len(loop) for loop in loops] == [4, 16]
    assert set(loops[0].tolist()) == {6, 7, 11, 12}


def test_a_cut_leaves_what_is_on_this_side() -> None:
    vertices = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0], [0.0, 2.0, 0.0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    for side in (1.0, -1.0):
        places, left = cut(vertices, triangles, lambda where, side=side: side * where[:, 0] > side * 0.8)
        a, b, c = (places[left[:, k], :2] for k in range(3))
        areas = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
        assert (areas > 0.0).all()
        assert areas.sum() == pytest.approx(1.6 if side > 0.0 else 2.4, abs=2e-3)


def test_borders_of_parts_that_meet_at_vertices_are_no_holes() -> None:
    """Three triangles, of which the middle one meets both others at a corner: its border has no way around."""
    triangles = np.array([[0, 1, 2], [0, 3, 4], [1, 5, 6]])
    vertices = np.random.default_rng(0).uniform(size=(7, 3))
    closed, filled = without_small_holes(vertices, triangles, 1e-6)
    np.testing.assert_array_equal(closed, vertices)
    np.testing.assert_array_equal(filled, triangles)

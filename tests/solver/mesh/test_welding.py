"""Which vertices on open borders are held together: copies along seams, and nothing that only lies close by."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sparse_surface.solver.errors import InputError
from sparse_surface.solver.mesh.welding import (
    automatic_distance,
    find_weld,
    largest_distance,
    may_coincide,
    stand_apart,
)

GRID = 5


def sheet(size: int = GRID) -> tuple[np.ndarray, np.ndarray]:
    axis = np.arange(size, dtype=float)
    x, y = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
    i = np.arange(size * size).reshape(size, size)
    one = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:]], axis=2).reshape(-1, 3)
    two = np.stack([i[:-1, :-1], i[1:, 1:], i[:-1, 1:]], axis=2).reshape(-1, 3)
    return np.stack([x, y, 0.3 * np.sin(x)], axis=1), np.concatenate([one, two])


def soup(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return points[triangles].reshape(-1, 3), np.arange(triangles.size).reshape(-1, 3)


def same_faces(place: np.ndarray, triangles: np.ndarray, expected: np.ndarray) -> bool:
    """Whether the places are the expected vertices, whatever their numbers."""
    pairs = {(int(a), int(b)) for a, b in zip(place[triangles].ravel(), expected.ravel(), strict=True)}
    return len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})


@given(st.floats(0.0, 0.9), st.integers(0, 100))
def test_a_soup_of_triangles_becomes_the_mesh_it_was(share: float, seed: int) -> None:
    points, triangles = sheet()
    apart, own = soup(points, triangles)
    distance = automatic_distance(apart, own)
    noise = np.random.default_rng(seed).normal(size=apart.shape)
    apart += share * 0.5 * distance * noise / np.linalg.norm(noise, axis=1, keepdims=True)
    weld = find_weld(apart, own, distance)
    assert weld is not None
    assert len(weld.first) == len(points)
    assert same_faces(weld.place, own, triangles)
    assert np.array_equal(weld.place[weld.first], np.arange(len(weld.first)))


def test_a_mesh_without_copies_stays_as_it_is() -> None:
    points, triangles = sheet()
    assert find_weld(points, triangles, automatic_distance(points, triangles)) is None


def test_sheets_on_top_of_each_other_stay_two() -> None:
    """As double-sided leaves and cards of game models: joined at their border they would be a pillow."""
    points, triangles = sheet()
    both = np.concatenate([points, points])
    faces = np.concatenate([triangles, triangles[:, ::-1] + len(points)])
    assert find_weld(both, faces, 1e-6) is None
    apart, own = soup(both, faces)
    weld = find_weld(apart, own, 1e-6)
    assert weld is not None
    assert same_faces(weld.place, own, faces)


def test_parts_that_touch_at_a_point_stay_apart() -> None:
    points, triangles = sheet()
    both = np.concatenate([points, points + np.array([GRID - 1.0, GRID - 1.0, points[-1, 2] - points[0, 2]])])
    assert find_weld(both, np.concatenate([triangles, triangles + len(points)]), 1e-6) is None


def test_no_triangle_loses_a_corner() -> None:
    points, triangles = sheet()
    points[1] = points[0] + np.array([0.0, 1e-7, 0.0])  # an edge shorter than the distance
    apart, own = soup(points, triangles)
    weld = find_weld(apart, own, 1e-5)
    assert weld is not None
    corners = weld.place[own]
    assert (corners != np.roll(corners, -1, axis=1)).all()
    assert len(weld.first) < len(apart) / 3


def test_a_third_sheet_at_a_seam_is_held_to_it() -> None:
    points, triangles = sheet()
    up = np.stack([np.full(len(points), GRID - 1.0), points[:, 1], points[-1, 2] + points[:, 0]], axis=1)
    right = points * np.array([-1.0, 1.0, 1.0]) + np.array([2.0 * (GRID - 1.0), 0.0, 0.0])
    number = len(points)
    weld = find_weld(
        np.concatenate([points, right, up]), np.concatenate([triangles + k * number for k in range(3)]), 1e-6
    )
    assert weld is not None
    assert weld.merged == 2 * GRID


def test_georeferenced_single_precision() -> None:
    """Far from the origin a millionth of the size is less than a step of the numbers."""
    points, triangles = sheet()
    far = (points + np.array([4.0e6, 5.0e6, 100.0])).astype(np.float32)
    assert automatic_distance(far, triangles) >= 0.5 > automatic_distance(points.astype(np.float32), triangles)


def test_a_vertex_far_away_holds_nothing_together() -> None:
    """In a map's coordinates, a vertex left at the origin made a millionth of the size five metres."""
    points, triangles = sheet()
    lost = np.concatenate([points + np.array([4.0e6, 5.0e6, 100.0]), np.zeros((3, 3))])
    lost[-2:, :2] += np.eye(2)
    triangles = np.concatenate([triangles, [[len(lost) - 3, len(lost) - 2, len(lost) - 1]]])
    assert automatic_distance(lost, triangles) < 0.1
    assert find_weld(lost, triangles, automatic_distance(lost, triangles)) is None


def test_a_distance_beyond_the_details_is_refused() -> None:
    points, triangles = sheet(30)
    with pytest.raises(InputError, match="larger than the details"):
        find_weld(*soup(points, triangles), 50.0)


def test_copies_are_never_overlooked_and_seldom_supposed() -> None:
    random = np.random.default_rng(5)
    grid = np.stack(np.meshgrid(*3 * [np.arange(12.0)], indexing="ij"), axis=-1).reshape(-1, 3)
    for kind in (np.float32, np.float64):
        places = (grid + random.uniform(-0.2, 0.2, grid.shape)).astype(kind)
        distance = automatic_distance(places, np.zeros((0, 3), dtype=np.int64))
        assert not may_coincide(places, 0.0)
        assert not may_coincide(places, 0.05)
        for _ in range(50):
            direction = random.normal(size=3)
            near = places[random.integers(len(places))] + 0.7 * distance * direction / np.linalg.norm(direction)
            assert may_coincide(np.concatenate([places, [near.astype(kind)]]), 0.0)
            far = places[random.integers(len(places))] + 0.049 * direction / np.linalg.norm(direction)
            assert may_coincide(np.concatenate([places, [far.astype(kind)]]), 0.05)
    assert may_coincide(np.zeros((3, 3)), 0.0)
    assert may_coincide(grid, 1e-9)  # more cells than can be numbered


@given(st.integers(2, 60), st.sampled_from([1e-6, 0.02, 0.1, 0.5]), st.integers(0, 1000))
def test_points_stand_apart_only_where_all_do(count: int, distance: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    points = random.random((count, 3)) * [1.0, 1.0, seed % 2]
    copied = random.integers(count, size=2)
    points[copied[0]] = points[copied[1]] + 0.99 * distance * random.uniform(-0.5, 0.5, 3) * (seed % 3 == 0)
    away = np.linalg.norm(points[:, None] - points, axis=2)[np.triu_indices(count, 1)]
    if stand_apart(points, distance):
        assert away.min() > distance


def test_points_of_grids_are_known_to_stand_apart() -> None:
    for points in (sheet(60)[0], sheet(60)[0] * [1.0, 1.0, 0.0] + [5e5, 5e6, 0.0]):
        distance = largest_distance(points)
        assert distance >= automatic_distance(points, sheet(60)[1])
        assert stand_apart(points, distance)
        assert not stand_apart(np.concatenate([points, points[7:8] + 0.5 * distance]), distance)
    assert not stand_apart(np.zeros((3, 3)), 0.0)
    assert stand_apart(np.zeros((1, 3)), 0.0)
    whole = np.arange(12).reshape(-1, 3)
    assert largest_distance(whole) >= automatic_distance(whole, np.array([[0, 1, 2]]))

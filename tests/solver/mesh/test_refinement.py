"""Bisection: nothing hangs, nothing moves, nothing becomes a sliver."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay
from sparse_surface.solver.mesh.refinement import bisected


def flat(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    points = np.random.default_rng(seed).uniform(size=(150, 2))
    triangles = Delaunay(points).simplices.astype(np.int64)
    return np.column_stack([points, np.zeros(len(points))]), triangles


def areas(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Signed ones, in the plane."""
    a, b, c = (vertices[triangles[:, k], :2] for k in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def smallest_angle(vertices: np.ndarray, triangles: np.ndarray) -> float:
    angles = []
    for k in range(3):
        one = vertices[triangles[:, (k + 1) % 3]] - vertices[triangles[:, k]]
        two = vertices[triangles[:, (k + 2) % 3]] - vertices[triangles[:, k]]
        cosine = (one * two).sum(axis=1) / np.linalg.norm(one, axis=1) / np.linalg.norm(two, axis=1)
        angles.append(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return float(np.min(angles))


def euler(vertices: np.ndarray, triangles: np.ndarray) -> int:
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    distinct, uses = np.unique(sides, axis=0, return_counts=True)
    assert uses.max() == 2
    return len(vertices) - len(distinct) + len(triangles)


def test_repeated_bisection_tiles_the_same_area_and_keeps_angles() -> None:
    vertices, triangles = flat()
    random = np.random.default_rng(1)
    whole, angle = areas(vertices, triangles).sum(), smallest_angle(vertices, triangles)
    for _ in range(4):
        count = len(vertices)
        fine, triangles = bisected(vertices, triangles, random.uniform(size=len(triangles)) < 0.1)
        np.testing.assert_array_equal(fine[:count], vertices)
        vertices = fine
        assert (areas(vertices, triangles) > 0.0).all()
        assert np.isclose(areas(vertices, triangles).sum(), whole, rtol=1e-12)
        assert euler(vertices, triangles) == 1
    assert smallest_angle(vertices, triangles) >= 0.5 * angle - 1e-12


def test_a_wanted_triangle_becomes_four() -> None:
    vertices, triangles = flat(2)
    largest = int(areas(vertices, triangles).argmax())
    wanted = np.arange(len(triangles)) == largest
    fine, finer = bisected(vertices, triangles, wanted)
    corners = vertices[triangles[largest], :2]
    centres = fine[finer, :2].mean(axis=1)
    # barycentric coordinates of the centres tell which triangles lie inside
    shares = np.linalg.solve(np.vstack([corners.T, np.ones(3)]), np.vstack([centres.T, np.ones(len(centres))]))
    assert int((shares > 0.0).all(axis=0).sum()) == 4


def test_nothing_wanted_changes_nothing() -> None:
    vertices, triangles = flat(3)
    fine, finer = bisected(vertices, triangles, np.zeros(len(triangles), dtype=bool))
    np.testing.assert_array_equal(fine, vertices)
    assert {tuple(sorted(each)) for each in finer.tolist()} == {tuple(sorted(each)) for each in triangles.tolist()}

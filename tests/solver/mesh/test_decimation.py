"""Decimation: how many vertices are left, and what it must not change."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_models import sphere
from sparse_surface.solver.mesh.decimation import decimated, triangle_shapes


def grid(count: int = 30) -> tuple[np.ndarray, np.ndarray]:
    axis = np.linspace(0.0, 1.0, count)
    x, y = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    one = np.stack([corner, corner + count, corner + count + 1], axis=1)
    other = np.stack([corner, corner + count + 1, corner + 1], axis=1)
    return np.column_stack([x, y, 0.0 * x]), np.concatenate([one, other])


def side_counts(triangles: np.ndarray) -> np.ndarray:
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    return np.unique(sides, axis=0, return_counts=True)[1]


@pytest.mark.parametrize("count", [300, 60, 12])
def test_a_sphere_stays_closed_and_round(count: int) -> None:
    vertices, triangles = sphere(12)
    radius = np.linalg.norm(vertices, axis=1).mean()
    fewer, left = decimated(vertices, triangles, count)
    assert len(fewer) == count
    assert len(left) == 2 * count - 4, "Euler's formula of a sphere"
    assert np.all(side_counts(left) == 2)
    a, b, c = (fewer[left[:, k]] for k in range(3))
    assert ((np.cross(b - a, c - a) * a).sum(axis=1) > 0.0).all()
    assert np.linalg.norm(fewer, axis=1) == pytest.approx(radius, rel=0.3)
    assert np.bincount(left.ravel()).min() >= 3
    assert triangle_shapes(fewer, left).min() > 0.15


def test_a_square_keeps_its_plane_its_border_and_its_area() -> None:
    vertices, triangles = decimated(*grid(), 40)
    assert len(vertices) == 40
    uses = side_counts(triangles)
    assert set(uses) == {1, 2}
    assert len(vertices) - len(uses) + len(triangles) == 1, "Euler's formula of a disk"
    np.testing.assert_allclose(vertices[:, 2], 0.0, atol=1e-9)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    up = np.cross(b - a, c - a)[:, 2]
    assert up.min() > 0.0
    assert up.sum() / 2 == pytest.approx(1.0, abs=0.03)


def test_what_cannot_become_smaller_stays() -> None:
    tetrahedron = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    vertices, triangles = decimated(tetrahedron, faces, 3)
    np.testing.assert_array_equal(vertices, tetrahedron)
    np.testing.assert_array_equal(triangles, faces)


def test_shape_is_one_for_an_equilateral_triangle() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, np.sqrt(0.75), 0], [2, 0, 0]])
    np.testing.assert_allclose(triangle_shapes(vertices, np.array([[0, 1, 2], [0, 1, 3]])), [1.0, 0.0], atol=1e-12)

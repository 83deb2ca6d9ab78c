"""Level sets on a grid near points: closed manifolds wound outwards, and borders where values are missing."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.solver.reconstruction.level_set import Grid, level_set


def ball_grid(step: float = 0.1) -> Grid:
    random = np.random.default_rng(0).normal(size=(4000, 3))
    return Grid.around(random / np.linalg.norm(random, axis=1)[:, None], 0.3, step)


def side_counts(triangles: np.ndarray) -> np.ndarray:
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    return np.unique(sides, axis=0, return_counts=True)[1]


def test_the_grid_holds_every_node_near_a_point_once() -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, -2.0]])
    grid = Grid.around(points, 0.3, 0.1)
    assert len(np.unique(grid.nodes, axis=0)) == len(grid.nodes)
    box = np.stack(np.meshgrid(*[np.arange(size) for size in grid.shape], indexing="ij"), axis=-1).reshape(-1, 3)
    there = np.zeros(grid.shape, dtype=bool)
    there[tuple(grid.nodes.T)] = True
    positions = grid.origin + grid.step * box
    near = (np.abs(positions[:, None] - points).max(axis=2) <= 0.3).any(axis=1)
    assert there[tuple(box[near].T)].all()
    assert len(grid.nodes) < 0.2 * len(box)


def test_a_sphere() -> None:
    grid = ball_grid()
    vertices, triangles = level_set(grid, np.linalg.norm(grid.positions, axis=1) - 1.0)
    uses = side_counts(triangles)
    assert np.all(uses == 2)
    assert len(vertices) - len(uses) + len(triangles) == 2
    assert np.linalg.norm(vertices, axis=1) == pytest.approx(1.0, abs=0.03)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    assert (a * np.cross(b, c)).sum() / 6 == pytest.approx(4 / 3 * np.pi, rel=0.03)


def test_values_that_are_missing_leave_a_border() -> None:
    grid = ball_grid()
    values = np.linalg.norm(grid.positions, axis=1) - 1.0
    vertices, triangles = level_set(grid, np.where(grid.positions[:, 2] > 0.0, values, np.nan))
    uses = side_counts(triangles)
    assert set(uses) == {1, 2}
    assert len(vertices) - len(uses) + len(triangles) == 1
    assert vertices[:, 2].min() > 0.0


def test_a_function_without_a_zero_has_no_surface() -> None:
    grid = ball_grid()
    vertices, triangles = level_set(grid, np.ones(len(grid.keys)))
    assert vertices.shape == triangles.shape == (0, 3)

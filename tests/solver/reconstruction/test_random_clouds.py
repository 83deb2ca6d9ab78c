"""Clouds drawn at random: shape, density, noise, strays, doubles.  A surface must stay near its points or its base."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial import cKDTree
from sparse_surface.solver import CloudSettings, Settings, run_to_end
from sparse_surface.solver.interchange import CloudArrays
from sparse_surface.solver.mesh.closest_points import closest_points
from sparse_surface.solver.reconstruction.evaluated import reconstruct_arrays

Random = np.random.Generator
CLOUDS = 200


def sphere(random: Random, count: int) -> np.ndarray:
    points = random.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def torus(random: Random, count: int) -> np.ndarray:
    around, across = random.uniform(0.0, 2.0 * np.pi, (2, 2 * count))
    even = random.uniform(0.0, 1.4, 2 * count) < 1.0 + 0.4 * np.cos(across)
    around, across = around[even][:count], across[even][:count]
    wide = 1.0 + 0.4 * np.cos(across)
    return np.column_stack([wide * np.cos(around), wide * np.sin(around), 0.4 * np.sin(across)])


def two_spheres(random: Random, count: int) -> np.ndarray:
    return np.concatenate([sphere(random, count // 2), 0.8 * sphere(random, count - count // 2) + [2.6, 0.0, 0.0]])


def sheet(random: Random, count: int) -> np.ndarray:
    u = random.uniform(-1.0, 1.0, (count, 2))
    return np.column_stack([u, 0.2 * np.sin(3.0 * u[:, 0]) * np.cos(2.0 * u[:, 1])])


def fold(random: Random, count: int) -> np.ndarray:
    u = random.uniform(0.0, 1.0, (count, 2))
    up = random.integers(0, 2, count) == 1
    return np.where(up[:, None], np.column_stack([u[:, 0], 0.0 * up, u[:, 1]]), np.column_stack([u, 0.0 * up]))


def box(random: Random, count: int) -> np.ndarray:
    points = random.uniform(-1.0, 1.0, (count, 3))
    axis = random.integers(0, 3, count)
    points[np.arange(count), axis] = random.choice([-1.0, 1.0], count)
    return points


SHAPES: dict[Callable[[Random, int], np.ndarray], int] = {
    sphere: 2,
    torus: 0,
    two_spheres: 4,
    sheet: 1,
    fold: 1,
    box: 2,
}
"""Each with its Euler characteristic."""


def drawn(seed: int) -> tuple[np.ndarray, float, int]:
    """A cloud, its noise, and its Euler characteristic."""
    random = np.random.default_rng(seed)
    shape = list(SHAPES)[seed % len(SHAPES)]
    clean = shape(random, int(random.integers(1200, 4000)))
    spacing = float(np.median(cKDTree(clean).query(clean, k=9)[0][:, 8])) * np.sqrt(np.pi / 8.0)
    noise = float(random.choice([0.0, 0.1, 0.3])) * spacing
    points = clean + noise * random.normal(size=clean.shape)
    low, high = points.min(axis=0) - 0.3, points.max(axis=0) + 0.3
    strays = random.uniform(low, high, (int(random.uniform(0.0, 0.03) * len(points)), 3))
    doubles = points[: int(random.uniform(0.0, 0.5) * len(points))]
    return np.concatenate([points, strays, doubles]), noise, SHAPES[shape]


@pytest.mark.parametrize("seed", [pytest.param(n, marks=[pytest.mark.long] if n >= 2 else []) for n in range(CLOUDS)])
def test_a_surface_stays_near_its_points_or_its_base(seed: int) -> None:
    points, noise, euler = drawn(seed)
    arrays = CloudArrays.of_points(points, CloudSettings())
    outcome = run_to_end(reconstruct_arrays(arrays, Settings(workers=1, iterations=4)))
    vertices = outcome.vertices.astype(np.float64)
    base, triangles = (each.astype(kind) for each, kind in zip(outcome.made_base, (np.float64, np.int64), strict=True))
    off_base = np.linalg.norm(closest_points(vertices, base, triangles).on(base, triangles) - vertices, axis=1)
    away = np.minimum(cKDTree(points).query(vertices)[0], off_base)
    assert away.max() < 3.0 * outcome.report["input"]["spacing"] + 3.0 * noise
    assert outcome.report["euler"] == euler

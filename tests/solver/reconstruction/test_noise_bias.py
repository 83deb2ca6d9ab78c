"""What wide noise puts a fitted surface off the true one, and that it is taken away."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.solver import CloudSettings, Settings, reconstruct
from sparse_surface.solver.reconstruction import reconstruct as reconstruction
from sparse_surface.solver.reconstruction.noise_bias import significant

RADIUS, NOISE = 1.0, 0.25


def noisy_ball(seed: int, count: int = 2500) -> np.ndarray:
    random = np.random.default_rng(seed)
    points = random.normal(size=(count, 3))
    return RADIUS * points / np.linalg.norm(points, axis=1, keepdims=True) + NOISE * random.normal(size=(count, 3))


def radii(points: np.ndarray) -> np.ndarray:
    """Distances of the surface that is fitted to points from the middle of the ball."""
    vertices = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 3**0.5
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return np.linalg.norm(surface_of(points, vertices, faces), axis=1)


def surface_of(points: np.ndarray, vertices: np.ndarray, faces: list[list[int]]) -> np.ndarray:
    """Places of the surface over a base."""
    result = reconstruct(points, vertices, faces, Settings(workers=1, iterations=2), CloudSettings(ring=1))
    places = np.random.default_rng(3).dirichlet(np.ones(3), 50)
    count = len(result.representation.triangles)
    return result.representation.evaluate(np.repeat(np.arange(count), 50), np.tile(places, (count, 1)))


@pytest.mark.parametrize("seed", [1, 2])
def test_noise_hardly_blows_a_ball_up(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of points of a ball with noise s in all directions more lie outside: their mean radius is R + s^2 / R."""
    corrected = radii(noisy_ball(seed)).mean() - RADIUS
    monkeypatch.setattr(reconstruction, "NOISIEST", np.inf)
    bulge = radii(noisy_ball(seed)).mean() - RADIUS
    assert bulge > 0.7 * NOISE**2 / RADIUS
    assert abs(corrected) < 0.35 * bulge


def test_a_sheet_with_a_border_stays_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its noise may be the thickness of a plate of which it is both sides."""
    random = np.random.default_rng(5)
    points = np.column_stack([random.uniform(-1.0, 1.0, (800, 2)), 0.15 * random.normal(size=800)])
    grid = np.linspace(-1.0, 1.0, 4)
    vertices = np.column_stack([np.repeat(grid, 4), np.tile(grid, 4), np.zeros(16)])
    faces = [[k, k + 4, k + 5, k + 1] for k in range(11) if k % 4 < 3]
    surface = surface_of(points, vertices, faces)
    monkeypatch.setattr(reconstruction, "NOISIEST", np.inf)
    np.testing.assert_array_equal(surface, surface_of(points, vertices, faces))


def test_means_of_nothing_but_chance_are_shrunk_and_others_stay() -> None:
    random = np.random.default_rng(7)
    weights = random.uniform(20.0, 40.0, (2, 500))
    chance = random.normal(size=(2, 500)) * np.sqrt(weights)
    kept, before = significant(chance, weights), chance.sum(axis=0) / weights.sum(axis=0)
    assert (kept**2).sum() < 0.4 * (before**2).sum()
    np.testing.assert_allclose(significant(chance + 3.0 * weights, weights), before + 3.0, atol=0.02)
    unseen = significant(np.zeros((2, 3)), np.zeros((2, 3)))
    np.testing.assert_array_equal(unseen, np.zeros(3))

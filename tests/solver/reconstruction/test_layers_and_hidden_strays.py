"""What a fit shows of a cloud: strays that its noise hid, and two layers that became one sheet."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from sparse_surface.solver import CloudSettings, Settings, run_to_end
from sparse_surface.solver.interchange import CloudArrays, CloudOutcome
from sparse_surface.solver.reconstruction.evaluated import reconstruct_arrays


def solved(points: np.ndarray, **cloud: str) -> CloudOutcome:
    arrays = CloudArrays.of_points(points, CloudSettings(**cloud))
    return run_to_end(reconstruct_arrays(arrays, Settings(workers=1, iterations=4)))


def plate(thickness: float) -> np.ndarray:
    """Points on all sides of a box, as dense on each."""
    high = np.array([1.0, 0.7, thickness])
    random, areas = np.random.default_rng(0), high.prod() / high
    axis = random.choice(3, 4000, p=areas / areas.sum())
    points = random.uniform(0.0, 1.0, (4000, 3)) * high
    points[np.arange(4000), axis] = random.integers(0, 2, 4000) * high[axis]
    return points


@pytest.mark.parametrize(("thickness", "layered"), [(0.015, True), (0.3, False)])
def test_two_layers_that_became_one_sheet_are_named(thickness: float, layered: bool) -> None:
    assert solved(plate(thickness)).report["input"]["layered"] is layered


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_noise_is_no_layer(noise: float) -> None:
    random = np.random.default_rng(1)
    u = random.uniform(-1.0, 1.0, (2000, 2))
    height = 0.2 * np.sin(2.0 * u[:, 0]) + noise * random.normal(size=2000)
    assert solved(np.column_stack([u, height])).report["input"]["layered"] is False


def bent_tube(random: np.random.Generator, count: int) -> np.ndarray:
    t, s = random.uniform(0.0, 2.0 * np.pi, (2, count))

    def middle(t: np.ndarray) -> np.ndarray:
        wide = 1.0 + 0.3 * np.cos(3.0 * t)
        return np.column_stack([np.cos(t) * wide, np.sin(t) * wide, 0.4 * np.sin(3.0 * t)])

    along = middle(t + 1e-5) - middle(t)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    one = np.cross(along, [0.0, 0.0, 1.0])
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    return middle(t) + 0.25 * (np.cos(s)[:, None] * one + np.sin(s)[:, None] * np.cross(along, one))


@pytest.mark.parametrize("seed", [8, 12])
def test_strays_in_the_noise_do_not_bend_the_surface(seed: int) -> None:
    random = np.random.default_rng(seed)
    points = bent_tube(random, 6000)
    size = float(np.ptp(points, axis=0).max())
    points += random.normal(0.0, 0.003 * size, points.shape)
    low, high = points.min(axis=0) - 0.2 * size, points.max(axis=0) + 0.2 * size
    outcome = solved(np.concatenate([points, random.uniform(low, high, (120, 3))]))
    truth = cKDTree(bent_tube(np.random.default_rng(2), 400_000))
    away = truth.query(outcome.vertices.astype(np.float64))[0] / size
    assert np.sqrt((away**2).mean()) < 2.5e-3
    assert away.max() < 1e-2
    # of the points themselves hardly any is left out
    assert (outcome.point_weight[:6000] == 0.0).mean() < 0.01

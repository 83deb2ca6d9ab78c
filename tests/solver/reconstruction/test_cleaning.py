"""What a clean look at a cloud leaves out, and what it must not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from sparse_surface.benchmarks.generated_clouds import airplane, ball, box, head, hill, l_solid
from sparse_surface.solver.reconstruction.cleaning import clean, far_origin
from sparse_surface.solver.reconstruction.strays import stray_points


def in_spacings(distance: np.ndarray, points: np.ndarray) -> np.ndarray:
    return distance / np.median(cKDTree(points).query(points, k=5)[0][:, 4])


@pytest.mark.parametrize(
    "cloud",
    [ball(3000, noise=0.005), box(3000), box(3000, noise=0.01), l_solid(3000), head(3000, 50), hill(3000, noise=0.005)],
)
def test_clouds_without_strays_keep_their_points(cloud) -> None:
    assert stray_points(cloud.points).sum() <= 0.001 * len(cloud.points)


def test_where_points_are_sparser_they_are_not_stray() -> None:
    points = box(6000).points
    half_as_dense = np.concatenate([points[points[:, 0] < 0.0], points[points[:, 0] >= 0.0][::10]])
    assert stray_points(half_as_dense).sum() <= 3
    random = np.random.default_rng(5).random((6000, 2))
    z, angle = 2.0 * random[:, 0] ** 3 - 1.0, 2.0 * np.pi * random[:, 1]
    across = np.sqrt(1.0 - z**2)
    assert stray_points(np.column_stack([across * np.cos(angle), across * np.sin(angle), z])).sum() <= 3


@pytest.mark.parametrize("share", [0.01, 0.02, 0.1])
@pytest.mark.parametrize("cloud", [ball(3000, noise=0.003), airplane(5000), l_solid(3000), hill(3000)])
def test_strays_are_found_whatever_their_share(cloud, share: float) -> None:
    points, count = cloud.points, int(share * len(cloud.points))
    low, high = points.min(axis=0) - 0.1, points.max(axis=0) + 0.1
    strays = np.random.default_rng(1).uniform(low, high, size=(count, 3))
    found = stray_points(np.concatenate([points, strays]))
    assert found[: len(points)].sum() <= 0.002 * len(points)
    away = in_spacings(cKDTree(points).query(strays)[0], points)
    assert found[len(points) :][away > 5.0].mean() > 0.97


def test_doubles_are_merged_whether_exact_or_not() -> None:
    points = np.random.default_rng(0).uniform(size=(500, 3))
    jitter = np.random.default_rng(1).uniform(-1e-7, 1e-7, size=(2, 500, 3))
    found = clean(np.concatenate([points, points, points + jitter[0], points + jitter[1]]), keep_strays=True)
    assert found.duplicates == 1500
    np.testing.assert_allclose(found.points, points, atol=1e-7)
    np.testing.assert_array_equal(found.source, np.tile(np.arange(500), 4))


def test_attributes_of_doubles_are_averaged() -> None:
    points = np.random.default_rng(0).uniform(size=(60, 3))
    values = np.arange(120.0)[:, None]
    found = clean(np.concatenate([points, points]), keep_strays=True)
    np.testing.assert_allclose(found.averaged(values)[:, 0], np.arange(60.0) + 30.0)


def test_a_cloud_without_faults_stays_as_it_is() -> None:
    points = ball(1000).points
    found = clean(points)
    np.testing.assert_array_equal(found.points, points)
    counts = {"points": 1000, "used": 1000, "duplicates": 0, "strays": 0, "not_finite": 0, "shift": [0.0, 0.0, 0.0]}
    assert found.counts() == counts


def test_the_origin_moves_only_where_single_precision_would_show() -> None:
    points = 40.0 * np.random.default_rng(0).uniform(size=(100, 3))
    assert not far_origin(points).any()
    far = points + np.array([500_000.0, 5_600_000.0, 200.0])
    far[3] = np.nan
    origin = far_origin(far)
    np.testing.assert_array_equal(origin, np.round(origin))
    assert np.nanmax(np.abs(far - origin)) < 41.0

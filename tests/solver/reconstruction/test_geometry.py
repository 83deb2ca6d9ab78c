"""What is read off a cloud before anything is fitted, on clouds whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from sparse_surface.benchmarks.generated_clouds import ball, box, head, l_solid
from sparse_surface.solver.reconstruction import geometry as module
from sparse_surface.solver.reconstruction.geometry import analyse, thinned


@pytest.mark.parametrize("noise", [0.001, 0.005, 0.02])
def test_noise_of_a_sphere_is_found(noise: float) -> None:
    assert analyse(ball(6000, 24, noise=noise).points).noise == pytest.approx(noise, rel=0.15)


def test_noise_is_found_although_creases_are_everywhere() -> None:
    assert analyse(l_solid(3000, noise=0.004).points).noise == pytest.approx(0.004, rel=0.15)


def test_clean_surfaces_have_next_to_no_noise() -> None:
    geometry = analyse(box().points)
    assert geometry.noise < 1e-6 * geometry.spacing
    geometry = analyse(head(8000, 50).points)
    assert geometry.noise < 0.01 * geometry.spacing


def test_spacing_is_that_of_the_area_a_point_has() -> None:
    # a sphere of diameter 1 has the area pi
    assert analyse(ball(5000, 24).points).spacing == pytest.approx(np.sqrt(np.pi / 5000), rel=0.1)


def test_normals_are_one_sided_at_edges() -> None:
    """Planes of least squares lie askew within some spacings of each edge: these do not."""
    normals = np.abs(analyse(box().points).normals)
    assert (normals.max(axis=1) > 0.99).mean() > 0.97


def test_normals_of_a_sphere_are_its_radii() -> None:
    cloud = ball(5000, 24)
    radii = cloud.points / np.linalg.norm(cloud.points, axis=1, keepdims=True)
    cosine = np.abs((analyse(cloud.points).normals * radii).sum(axis=1))
    assert np.degrees(np.arccos(cosine.min())) < 8.0


@pytest.mark.parametrize("cloud", [box(), l_solid()], ids=["box", "l_solid"])
def test_crease_points_lie_on_the_creases_and_cover_them(cloud) -> None:
    geometry = analyse(cloud.points)
    from_surface = cloud.distance(geometry.creases)
    assert np.median(from_surface) < 0.03 * geometry.spacing
    assert from_surface.max() < 0.3 * geometry.spacing
    # samples of the true creases are 0.01 apart
    to_crease = cKDTree(cloud.creases).query(geometry.creases)[0]
    assert np.quantile(to_crease, 0.95) < 0.5 * geometry.spacing
    covered = cKDTree(geometry.creases).query(cloud.creases)[0]
    assert np.quantile(covered, 0.9) < 1.5 * geometry.spacing


def test_smooth_surfaces_have_no_creases() -> None:
    assert len(analyse(head(20000, 50).points).creases) == 0
    assert len(analyse(ball(1410, 24).points).creases) == 0
    assert len(analyse(ball(9730, 24, noise=0.005).points).creases) < 20


def two_balls() -> np.ndarray:
    """A dense ball, and one with a hundredth of its points beside it."""
    return np.concatenate([ball(4000, 24).points + np.array([3.0, 0.0, 0.0]), ball(40, 24).points])


def noisy_box() -> np.ndarray:
    points = box().points
    return points + 0.6 * analyse(points).spacing * np.random.default_rng(1).normal(size=points.shape)


@pytest.mark.parametrize(
    ("guard", "off", "points"),
    [("BENT", 0.0, lambda: ball(300, 24).points), ("NOISIEST", np.inf, noisy_box), ("SPARSEST", np.inf, two_balls)],
    ids=["a smooth bend with few points", "noise", "much sparser points"],
)
def test_what_only_looks_like_a_crease_is_none(guard, off, points, monkeypatch) -> None:
    assert len(analyse(points()).creases) == 0
    monkeypatch.setattr(module, guard, off)
    assert len(analyse(points()).creases) > 0, "the cloud puts this guard to the test"


def test_few_points_are_no_obstacle() -> None:
    random = np.random.default_rng(0)
    for count in (4, 5, 9, 12):
        geometry = analyse(random.normal(size=(count, 3)))
        assert np.isfinite(geometry.spacing)
        assert geometry.normals.shape == (count, 3)
        assert np.isfinite(geometry.normals).all()


def test_points_at_one_place_many_times_are_no_obstacle() -> None:
    points = np.repeat(ball(300, 24).points, 30, axis=0)
    geometry = analyse(points)
    assert np.isfinite(geometry.normals).all()
    assert np.isfinite(geometry.noise)


def test_thinning_keeps_one_point_of_each_cell() -> None:
    points = np.array([[0.1, 0.1, 0.1], [0.2, 0.2, 0.2], [0.4, 0.3, 0.3], [1.5, 0.1, 0.1]])
    np.testing.assert_array_equal(thinned(points, 1.0), points[[1, 3]])


@pytest.mark.parametrize("noise", [0.01, 0.02, 0.04])
@pytest.mark.parametrize("make", [ball, box])
def test_noise_wider_than_the_spacing_is_not_underestimated(make, noise: float) -> None:
    assert analyse(make(9000, noise=noise).points).noise == pytest.approx(noise, rel=0.15)

"""Distances both ways: statistics of bodies where they are known, signs, clouds, refusals."""

from __future__ import annotations

import json

import numpy as np
import pytest
from distance_shapes import ball, box
from sparse_surface.solver.distance.distance import distance, distance_steps
from sparse_surface.solver.distance.settings import DistanceSettings
from sparse_surface.solver.distance.surfaces import Surface
from sparse_surface.solver.errors import InputError, SettingsError


def test_a_larger_ball_is_that_much_larger() -> None:
    """Radii 1.1 and 1: almost 0.1 apart everywhere."""
    settings = DistanceSettings(signed=True, tolerance=0.09, samples=5000)
    measured = distance(Surface.of(*ball(2000, 1.1)), Surface.of(*ball(2000)), settings)
    report = json.loads(json.dumps(measured.report))
    for way, sign in (("a_to_b", 1.0), ("b_to_a", -1.0)):
        assert report[way]["mean"] == pytest.approx(0.1, abs=5e-3)
        assert report[way]["signed_mean"] == pytest.approx(sign * 0.1, abs=5e-3)
        assert report[way]["max"] <= report[way]["max_bound"] <= report[way]["max"] + 2e-4
    assert report["hausdorff"] == max(report["a_to_b"]["max"], report["b_to_a"]["max"])
    assert report["inside_tolerance"] < 0.05
    assert sum(report["histogram"]["counts"]) == 5000
    assert report["histogram"]["edges"][0] == -report["histogram"]["edges"][-1]


def test_statistics_are_those_over_the_area() -> None:
    """A square 2 by 2 tilted over one that it starts from: the distance grows from 0 to h, evenly over the area."""
    square = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    tilted = square + [0, 0, 0.02] * (square[:, :1] / 2.0)
    report = distance(Surface.of(tilted, triangles), Surface.of(square * [2, 2, 1] - [1, 1, 0], triangles)).report
    assert report["a_to_b"]["mean"] == pytest.approx(0.01, rel=1e-3)
    assert report["a_to_b"]["rms"] == pytest.approx(0.02 / np.sqrt(3.0), rel=1e-3)
    assert report["a_to_b"]["p95"] == pytest.approx(0.019, rel=1e-3)
    assert report["a_to_b"]["max"] == pytest.approx(0.02)


def test_a_moved_copy_is_aligned_first() -> None:
    vertices, triangles = box((1.0, 0.6, 0.4))
    settings = DistanceSettings(align="rigid", samples=1000)
    away = vertices + np.array([3.0, 0.0, 1.0])
    measured = distance(Surface.of(away, triangles), Surface.of(vertices, triangles), settings)
    assert measured.report["hausdorff"] < 1e-7
    matrix = np.array(measured.report["alignment"])
    assert matrix.shape == (4, 4)
    assert np.linalg.det(matrix) == pytest.approx(1.0)


def test_a_cloud_is_measured_at_its_points() -> None:
    cloud = 1.5 * ball(50)[0]
    measured = distance(Surface.of(cloud), Surface.of(*ball(3000)), DistanceSettings(signed=True))
    report = measured.report
    assert report["a_to_b"]["samples"] == 50
    assert report["a_to_b"]["max"] == report["a_to_b"]["max_bound"] == pytest.approx(0.5, abs=5e-3)
    assert "signed_mean" in report["a_to_b"]
    assert "signed_mean" not in report["b_to_a"]


def test_the_same_surfaces_give_the_same_numbers() -> None:
    one, other = Surface.of(*ball(300)), Surface.of(*box())
    first, second = (distance(one, other, DistanceSettings(signed=True, samples=2000)) for _ in range(2))
    assert np.array_equal(first.a_to_b.distance, second.a_to_b.distance)
    assert first.report["a_to_b"] == second.report["a_to_b"]


def test_progress_never_falls_and_can_be_cancelled() -> None:
    surfaces = Surface.of(*ball(300)), Surface.of(*box())
    fractions = [step.fraction for step in distance_steps(*surfaces, DistanceSettings(align="rigid"))]
    assert fractions == sorted(fractions)
    assert fractions[-1] <= 1.0
    steps = distance_steps(*surfaces)
    next(steps)
    steps.close()


def test_what_cannot_be_measured_is_refused() -> None:
    cloud, mesh = Surface.of(ball(50)[0]), Surface.of(*box())
    with pytest.raises(InputError, match="no inside"):
        distance(mesh, cloud, DistanceSettings(signed=True))
    with pytest.raises(InputError, match="does not exist"):
        Surface.of(np.eye(3), [[0, 1, 3]])
    with pytest.raises(InputError, match="three corners"):
        Surface.of(np.eye(3), [[0, 1, 2, 0]])
    with pytest.raises(InputError, match="no area"):
        Surface.of(np.eye(3), [[0, 1, 1]])
    for wrong in ({"align": "loose"}, {"tolerance": -1.0}, {"samples": 1}, {"bins": 1}):
        with pytest.raises(SettingsError):
            DistanceSettings(**wrong)

"""The figures that docs/point-clouds.md shows, measured by its own benchmark."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.benchmarks import point_clouds
from sparse_surface.benchmarks.generated_clouds import ball
from sparse_surface.benchmarks.point_clouds import CASES, CloudCase, MeasuredCloud, measure
from sparse_surface.benchmarks.tables import Table

# Largest rms and maximum of the surface's distance from the true one, mean distance of the edges, rms of the fit.
LIMITS = {
    "noisy_ball": (2.3e-3, 2e-2, None, 6e-3),
    "noisy_ball_154": (8e-4, 1e-2, None, 6e-3),
    "box": (2.5e-3, 2.5e-2, 8e-3, 2.5e-3),
    "l_solid": (1.5e-3, 5e-2, 4e-3, 1.5e-3),
    "ball": (1e-3, 1e-2, None, 1e-3),
    "airplane": (2e-3, 2e-2, 4e-3, 2e-3),
    "head": (1e-4, 1e-3, None, 1e-4),
    "large": (1e-4, 1e-3, None, 1e-4),
}


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_figures_are_reached(name: str) -> None:
    found = measure(CASES[name])
    rms, largest, edges, fit = LIMITS[name]
    assert found.surface[0] <= rms
    assert found.surface[1] <= largest
    assert found.fit[0] <= fit
    assert found.flips == 0
    if edges is not None:
        assert found.edges is not None
        assert found.edges <= edges
    assert found.seconds <= 60.0


def test_every_case_has_limits() -> None:
    assert sorted(LIMITS) == sorted(CASES)


def test_a_small_cloud_is_measured_against_its_true_surface() -> None:
    found = measure(CloudCase("small", lambda: ball(300), ""))
    assert (found.points, found.base, found.flips) == (300, 24, 0)
    assert 0.0 < found.fit[0] < found.surface[0] < 0.01
    assert found.edges is None
    assert found.seconds > 0.0
    assert found.unit > 0.0


def test_a_cloud_is_a_row_of_the_table() -> None:
    row = MeasuredCloud("Ball", "little", 1410, 24, (1e-3, 2e-3), None, (3e-4, 4e-4), 0, 10.0, 0.05).row()
    lines = Table.of(point_clouds.HEAD, [row]).markdown().splitlines()
    assert "| Ball | 1,410 / 24 | 1.0e-03 / 2.0e-03 |  | 3.0e-04 / 4.0e-04 | 0 | 200 (10 s) | little |" in lines


def test_samples_of_the_surface_hang_together() -> None:
    cloud = ball(200)
    from sparse_surface.solver import Settings, reconstruct

    settings = Settings(workers=1, iterations=1, sweeps=0)
    result = reconstruct(cloud.points, cloud.base_vertices, cloud.base_faces, settings)
    points, triangles = point_clouds.evaluated(result, 4)
    assert len(triangles) == 16 * len(cloud.base_faces)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    volume = (a * np.cross(b, c)).sum() / 6.0
    assert volume == pytest.approx(np.pi / 6, rel=0.05)

"""A patch with hardly any points must not run away."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from sparse_surface.solver import CloudSettings, Settings, reconstruct


def height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.7 * np.sin((x + 48.0) / 5.0) * np.cos((y + 54.0) / 4.33)


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    """A gentle hill, one point a unit."""
    x, y = np.meshgrid(np.arange(-10.0, 1.0), np.arange(-10.0, 1.0), indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), height(x, y).ravel()])


@pytest.fixture(scope="module")
def eared_base() -> tuple[np.ndarray, list[list[int]]]:
    """An open base: the last triangle is a sliver, 5.5 long and 0.3 high, with a vertex of its own."""
    x, y = np.transpose(
        [
            (-10.16, -9.93),
            (-9.19, 0.47),
            (-5.17, 0.15),
            (-1.44, -1.12),
            (0.56, -7.35),
            (0.43, -4.34),
            (0.06, -2.85),
            (-0.47, -1.82),
            (-3.4, -0.2),
        ]
    )
    faces = [[1, 0, 2], [2, 3, 8], [2, 0, 4], [3, 2, 4], [3, 4, 5], [3, 5, 6], [3, 6, 7]]
    return np.column_stack([x, y, height(x, y)]), faces


@pytest.mark.parametrize("fit_base", [True, False])
def test_slivers_at_the_border_of_a_base_throw_no_spikes(points, eared_base, fit_base: bool) -> None:
    settings = Settings(workers=1)
    result = reconstruct(points, *eared_base, settings, CloudSettings(fit_base=fit_base))
    random = np.random.default_rng(0).dirichlet([1.0, 1.0, 1.0], size=(7, 400))
    on_surface = result.representation.evaluate(np.repeat(np.arange(7), 400), random.reshape(-1, 3))
    away = cKDTree(points).query(on_surface)[0]
    assert away.max() < 2.0
    assert result.report["surface_to_points"]["max"] == pytest.approx(away.max(), rel=0.15)

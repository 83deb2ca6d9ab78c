"""A patch with hardly any points must not run away."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from sparse_surface.solver import CloudSettings, Settings, reconstruct, run_to_end
from sparse_surface.solver.interchange import CloudArrays
from sparse_surface.solver.reconstruction.evaluated import reconstruct_arrays
from sparse_surface.solver.reconstruction.geometry import analyse
from sparse_surface.solver.reconstruction.tangent_planes import TangentPlanes


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


def test_corners_of_borders_do_not_run_out_along_their_planes() -> None:
    # a floor and three walls: at free corners points have neighbours on one side only, which must not look sparse
    random = np.random.default_rng(0)
    which, u = random.integers(0, 4, 6000), random.uniform(0.0, 1.0, (6000, 2))
    zero = np.zeros(6000)
    sides = [
        np.column_stack([u, zero]),
        np.column_stack([u[:, 0], zero, u[:, 1]]),
        np.column_stack([zero, u]),
        np.column_stack([u[:, 0], zero + 1.0, u[:, 1]]),
    ]
    points = np.stack(sides)[which, np.arange(6000)]
    outcome = run_to_end(reconstruct_arrays(CloudArrays.of_points(points, CloudSettings()), Settings(workers=1)))
    vertices = outcome.vertices.astype(np.float64)
    inside = vertices.clip(0.0, 1.0)
    off = np.minimum(np.minimum(inside[:, 0], inside[:, 2]), np.minimum(inside[:, 1], 1.0 - inside[:, 1]))
    assert np.hypot(np.linalg.norm(vertices - inside, axis=1), off).max() < 0.03
    assert outcome.report["euler"] == 1


def test_a_gap_between_points_drawn_at_random_is_no_run_away() -> None:
    """A triangle of a box became its base, which cuts the edge off by three spacings, for one place in such a gap."""
    x, y = (part.ravel() for part in np.meshgrid(np.arange(-10.0, 11.0), np.arange(-10.0, 11.0)))
    points = np.column_stack([x, y, np.zeros(len(x))])
    points = points[np.hypot(x, y) > 1.9]
    planes = TangentPlanes(points, analyse(points))
    place = np.zeros((3, 3))
    place[2, 2] = 168.0
    on_base = np.array([[0.0, 0.0, -3.0], [2.0, 0.0, -0.3], [0.0, 0.0, 0.0]])
    assert (planes.run_away(place, on_base) > 0.0).all()
    assert planes.nearer(place, on_base).tolist() == [True, False, False]

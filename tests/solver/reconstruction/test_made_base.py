"""Bases that are made from points: topology, size, and shape of their triangles."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from sparse_surface.benchmarks.generated_clouds import ball, box, head, hill, l_solid
from sparse_surface.solver import CloudSettings, Settings, reconstruct, run_to_end
from sparse_surface.solver.errors import InputError
from sparse_surface.solver.interchange import CloudArrays
from sparse_surface.solver.mesh.closest_points import closest_points
from sparse_surface.solver.mesh.decimation import triangle_shapes
from sparse_surface.solver.reconstruction.evaluated import reconstruct_arrays
from sparse_surface.solver.reconstruction.geometry import analyse
from sparse_surface.solver.reconstruction.made_base import Base, _Shell, _with_cavities, make_base


def euler_and_border(base: Base) -> tuple[int, int]:
    """V - E + T of a manifold, and how many edges have one triangle."""
    sides = np.sort(np.stack([base.triangles, np.roll(base.triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    uses = np.unique(sides, axis=0, return_counts=True)[1]
    assert uses.max() == 2
    return len(base.vertices) - len(uses) + len(base.triangles), int((uses == 1).sum())


def misfit(base: Base, points: np.ndarray) -> float:
    feet = closest_points(points, base.vertices, base.triangles)
    return float(np.linalg.norm(feet.on(base.vertices, base.triangles) - points, axis=1).max())


@pytest.mark.parametrize("count", [30, 150])
@pytest.mark.parametrize("cloud", [ball(2000, noise=0.002), box(3000), l_solid(3000), head(3000, 50)])
def test_closed_clouds(cloud, count: int) -> None:
    base = make_base(cloud.points, count)
    assert base.closed
    assert euler_and_border(base) == (2, 0)
    assert 0.9 * count <= len(base.vertices) <= 1.1 * count


@pytest.mark.parametrize("count", [30, 150])
@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_open_clouds(count: int, noise: float) -> None:
    cloud = hill(3000, noise=noise)
    base = make_base(cloud.points, count)
    euler, border = euler_and_border(base)
    assert not base.closed
    assert euler == 1
    assert border > 0
    assert 0.9 * count <= len(base.vertices) <= 1.1 * count
    assert triangle_shapes(base.vertices, base.triangles).min() > 0.1


def walls(count: int, points: int, seed: int) -> np.ndarray:
    """A floor and walls around it: unit squares with evenly random points."""
    random = np.random.default_rng(seed)
    which, u = random.integers(0, count, points), random.uniform(0.0, 1.0, (points, 2))
    zero = np.zeros(points)
    sides = [
        np.column_stack([u, zero]),
        np.column_stack([u[:, 0], zero, u[:, 1]]),
        np.column_stack([zero, u]),
        np.column_stack([u[:, 0], zero + 1.0, u[:, 1]]),
        np.column_stack([zero + 1.0, u]),
    ]
    return np.stack(sides)[which, np.arange(points)]


@pytest.mark.parametrize(
    ("count", "points"), [(2, 1500), (2, 6000), (3, 1500), (3, 6000), (4, 1500), (4, 6000), (5, 6000)]
)
def test_folds_of_open_clouds_are_not_torn(count: int, points: int) -> None:
    cloud = walls(count, points, 1)
    base = make_base(cloud)
    assert euler_and_border(base)[0] == 1
    assert misfit(base, cloud) < 0.08
    assert cKDTree(cloud).query(base.vertices)[0].max() < 0.1


@pytest.mark.parametrize("seed", [1, 3])
def test_a_bin_stays_open_and_the_surface_ends_where_its_points_do(seed: int) -> None:
    cloud = walls(5, 1500, seed)
    base = make_base(cloud)
    assert not base.closed
    assert euler_and_border(base)[0] == 1
    vertices = reconstruct(cloud, base.vertices, base.triangles, Settings(workers=1)).vertices
    # The walls are the faces of a unit cube but the lid, at z = 1.
    beyond = np.linalg.norm(vertices - vertices.clip(0.0, 1.0), axis=1)
    inside = vertices.clip(0.0, 1.0)
    off = np.minimum(np.minimum(inside[:, :2], 1.0 - inside[:, :2]).min(axis=1), inside[:, 2])
    assert np.hypot(beyond, off).max() < 0.03


def test_clouds_without_noise_get_more_vertices() -> None:
    exact, noisy = (len(make_base(ball(points=6000, noise=noise).points).vertices) for noise in (0.0, 0.005))
    assert exact == pytest.approx(6000 / 24, rel=0.1)
    assert noisy == pytest.approx(6000 / 36, rel=0.1)


def test_a_tube_has_two_borders_and_no_holes() -> None:
    random = np.random.default_rng(0).uniform(size=(4000, 2))
    height, angle = 2.0 * random[:, 1] - 1.0, 2.0 * np.pi * random[:, 0]
    catenoid = np.column_stack([np.cosh(height) * np.cos(angle), np.cosh(height) * np.sin(angle), height])
    assert euler_and_border(make_base(catenoid))[0] == 0


@pytest.mark.parametrize("times", [1.5, 2.0, 3.0])
def test_points_written_again_change_nothing(times: float) -> None:
    random = np.random.default_rng(0).uniform(size=(800, 2))
    once = np.column_stack([random, 0.2 * np.sin(4.0 * random[:, 0])])
    again = np.concatenate([once] * 3)[: int(800 * times)]
    one, other = make_base(once), make_base(again)
    np.testing.assert_array_equal(one.triangles, other.triangles)
    np.testing.assert_array_equal(one.vertices, other.vertices)
    assert euler_and_border(one)[0] == 1


def test_place_and_size_do_not_matter() -> None:
    cloud = l_solid(2000).points
    one, other = make_base(cloud), make_base(1024.0 * cloud)
    np.testing.assert_array_equal(one.triangles, other.triangles)
    np.testing.assert_array_equal(1024.0 * one.vertices, other.vertices)
    far = make_base(cloud + np.array([4096.0, -512.0, 64.0]))
    assert euler_and_border(far) == (2, 0)
    assert misfit(Base(far.vertices - [4096.0, -512.0, 64.0], far.triangles, True), cloud) < 0.1


def test_a_run_without_a_base_makes_this_one() -> None:
    cloud = ball(600).points.astype(np.float32)
    arrays = CloudArrays.of_points(cloud, CloudSettings(), base_count=40)
    settings = Settings(workers=1, iterations=2)
    steps, fractions = reconstruct_arrays(arrays, settings), []
    outcome = run_to_end(steps, lambda step: fractions.append(step.fraction))
    assert fractions == sorted(fractions)
    base = make_base(cloud, 40)
    vertices, triangles = outcome.made_base
    np.testing.assert_array_equal(vertices, base.vertices.astype(np.float32))
    np.testing.assert_array_equal(triangles, base.triangles)
    alone = reconstruct(cloud, vertices, triangles, settings)
    np.testing.assert_array_equal(outcome.point_error, alone.error)


def test_points_in_a_plane_are_refused() -> None:
    with pytest.raises(InputError, match="All the points lie in one plane: choose a base mesh"):
        make_base(np.random.default_rng(0).uniform(size=(100, 3)) * [1.0, 1.0, 0.0])


def test_noise_wider_than_the_spacing_leaves_no_handles() -> None:
    cloud = l_solid(6000, noise=0.02)
    base = make_base(cloud.points)
    assert base.closed
    assert euler_and_border(base) == (2, 0)
    assert cloud.distance(base.vertices).max() < 0.06


def test_foam_in_noise_as_wide_as_a_plate_is_not_taken_for_its_shell() -> None:
    """Plates with walls of 3.2 noise levels got bases with 22 and more handles."""
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    foam = _Shell(np.zeros((8, 3)), np.concatenate([tetrahedron, tetrahedron + 4]), closed=True)
    solid = _Shell(np.zeros((4, 3)), tetrahedron, closed=False)
    hollow = _Shell(np.zeros((4, 3)), tetrahedron, closed=True)
    assert foam.topology != solid.topology
    assert _with_cavities([foam, solid, solid], [solid], True) == []
    assert _with_cavities([foam, solid, solid], [solid], False) == [foam]
    assert _with_cavities([foam, solid], [], True) == [foam]
    assert _with_cavities([foam, hollow, hollow], [hollow], True) == [hollow]


@pytest.mark.parametrize("euler", [2, 1], ids=["ball", "hill"])
@pytest.mark.parametrize("level", [0.6, 1.0, 1.6])
def test_balls_and_sheets_keep_their_topology_in_wide_noise(euler: int, level: float) -> None:
    points = (ball(3000) if euler == 2 else hill(3000)).points
    noise = level * analyse(points).spacing
    random = np.random.default_rng(0)
    assert euler_and_border(make_base(points + noise * random.normal(size=points.shape)))[0] == euler

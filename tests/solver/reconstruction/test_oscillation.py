"""Patches that swing out between points are found and calmed."""

from __future__ import annotations

import numpy as np
from sparse_surface.benchmarks.generated_clouds import ball, box
from sparse_surface.solver.mesh.sampling import triangle_grid
from sparse_surface.solver.reconstruction.geometry import analyse
from sparse_surface.solver.reconstruction.oscillation import farthest
from sparse_surface.solver.reconstruction.tangent_planes import TangentPlanes


def test_planes_are_near_the_surface_and_far_from_what_is_off_it() -> None:
    for cloud in (ball(3000, 24), box()):
        geometry = analyse(cloud.points)
        planes = TangentPlanes(cloud.points, geometry)
        assert (planes.distance(cloud.points) < 0.1 * planes.tolerance).all()
    random = np.random.default_rng(0)
    directions = random.normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    cloud = ball(3000, 24)
    planes = TangentPlanes(cloud.points, analyse(cloud.points))
    assert (planes.distance(0.5 * directions) < 0.1 * planes.tolerance).all()
    assert (planes.distance(0.53 * directions) > planes.tolerance).all()


def test_along_its_planes_a_surface_may_run_away() -> None:
    plane = np.column_stack([np.random.default_rng(0).uniform(size=(2000, 2)), np.zeros(2000)])
    planes = TangentPlanes(plane, analyse(plane))
    far, beside = np.array([[9.0, 0.5, 0.0]]), np.array([[0.9, 0.5, 0.0]])
    assert planes.distance(far)[0] < 1e-12
    assert 8.0 - planes.room - 0.1 < planes.run_away(far, beside)[0] < 8.0
    # near the base, or near the points, it has not
    assert planes.run_away(far, far + 0.5 * planes.room)[0] == 0.0
    assert planes.run_away(beside, far)[0] == 0.0


def test_only_the_patch_that_leaves_is_found_and_only_where_it_counts() -> None:
    cloud = ball(3000, 24)
    planes = TangentPlanes(cloud.points, analyse(cloud.points))
    on_surface, off = cloud.points[:50], 1.2 * cloud.points[:50]

    def sampled(patch: int):
        weight = np.full(50, 0.0 if patch == 2 else 0.5)
        # a patch without any weight may be a little off
        return {0: on_surface, 1: off, 2: 1.05 * on_surface}[patch], on_surface, weight

    away = farthest(np.arange(3), planes, sampled)
    np.testing.assert_array_equal(away > planes.tolerance, [False, True, False])
    np.testing.assert_array_equal(farthest(np.array([2, 1]), planes, sampled), away[[2, 1]])


def test_grid_of_a_triangle() -> None:
    grid = triangle_grid(4)
    assert len(grid) == 15
    np.testing.assert_allclose(grid.sum(axis=1), 1.0)
    assert len(np.unique(grid, axis=0)) == 15

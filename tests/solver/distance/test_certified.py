"""The largest distance against bodies where it is known, and against libigl's."""

from __future__ import annotations

import numpy as np
import pytest
from distance_shapes import Shape, ball, box, soup
from sparse_surface.solver.distance.certified import Largest, largest_distance
from sparse_surface.solver.distance.targets import PointTarget, Target, TriangleTarget


def largest(shape: Shape, target: Target, tolerance: float = 1e-6) -> Largest:
    found = target.nearest(shape[0])
    return largest_distance(*shape, found.distance, found.element, target, tolerance)


def test_the_largest_distance_inside_a_triangle_is_found() -> None:
    flat = np.array([[-1.0, -1.0, 0.0], [2.0, -1.0, 0.0], [-1.0, 2.0, 0.0]])
    cloud = flat.copy()  # distance 0 at all corners; largest at the circumcentre, the middle of the long side
    measured = largest((flat, np.array([[0, 1, 2]])), PointTarget(cloud))
    assert measured.found == pytest.approx(3.0 / np.sqrt(2.0), abs=1e-5)
    assert measured.found <= 3.0 / np.sqrt(2.0) + 1e-12 <= measured.bound + 1e-6
    assert measured.place == pytest.approx([0.5, 0.5, 0.0], abs=1e-2)


@pytest.mark.parametrize("seed", range(5))
def test_the_bounds_enclose_what_libigl_finds(seed: int) -> None:
    igl = pytest.importorskip("igl")
    rng = np.random.default_rng(seed)
    one = soup(30, seed) if seed % 2 else ball(150)
    other = (ball(200, 1.05), box())[seed % 2 == 0]
    moved = other[0] + 0.1 * rng.normal(size=3), other[1]
    there = largest(one, TriangleTarget(*moved), 1e-5)
    back = largest(moved, TriangleTarget(*one), 1e-5)
    known = igl.hausdorff(*one, *moved)
    assert max(there.found, back.found) - 1e-9 <= known + 1e-4
    assert known <= max(there.bound, back.bound) + 1e-4
    assert there.bound - there.found <= 1.001e-5


@pytest.mark.parametrize("seed", range(3))
def test_no_place_is_farther_than_the_bound(seed: int) -> None:
    shape, target = soup(40, seed), TriangleTarget(*ball(300))
    measured = largest(shape, target, 1e-4)
    shares = np.random.default_rng(seed).dirichlet([1.0, 1.0, 1.0], 20_000)
    corners = shape[0][shape[1][np.arange(20_000) % 40]]
    everywhere = target.nearest((corners * shares[:, :, None]).sum(axis=1)).distance
    assert everywhere.max() <= measured.bound
    assert np.linalg.norm(measured.place - measured.partner) == pytest.approx(measured.found)

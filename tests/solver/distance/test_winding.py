"""Winding numbers against the plain sum over all triangles."""

from __future__ import annotations

import numpy as np
import pytest
from distance_shapes import Shape, ball, box, soup
from sparse_surface.solver.distance.winding import WindingNumbers, solid_angles


@pytest.mark.parametrize("shape", [box(), ball(3000), soup(500, 0)], ids=["box", "ball", "soup"])
def test_groups_sum_up_as_their_triangles_do(shape: Shape) -> None:
    vertices, triangles = shape
    places = np.random.default_rng(0).uniform(-1.5, 1.5, (200, 3))
    corners = vertices[triangles]
    expected = [solid_angles(np.tile(place, (len(corners), 1)), corners).sum() / (4 * np.pi) for place in places]
    fast = WindingNumbers(vertices, triangles)
    assert fast(places) == pytest.approx(expected, abs=0.05)
    assert fast(places, 100.0) == pytest.approx(expected, abs=1e-9)


def test_a_closed_surface_winds_once_around_what_is_inside() -> None:
    vertices, triangles = ball(500)
    numbers = WindingNumbers(vertices, triangles)(np.array([[0.0, 0.0, 0.0], [0.5, 0.4, 0.3], [2.0, 0.0, 0.0]]), 100.0)
    assert numbers == pytest.approx([1.0, 1.0, 0.0], abs=1e-9)


def test_an_octant_has_an_eighth_of_all_directions() -> None:
    octant = np.eye(3)[None]
    assert solid_angles(np.zeros((1, 3)), octant) == pytest.approx([np.pi / 2.0])
    assert solid_angles(np.full((1, 3), 1.0 / 3.0), octant) == pytest.approx([0.0])

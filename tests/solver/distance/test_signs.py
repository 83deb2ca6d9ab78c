"""Inside and outside, against the formulas of bodies and the plain sum over all triangles."""

from __future__ import annotations

import numpy as np
import pytest
from distance_shapes import Floats, Shape, ball, box
from sparse_surface.solver.distance.signs import Sides
from sparse_surface.solver.distance.targets import TriangleTarget


def inside(shape: Shape, places: Floats) -> np.ndarray:
    return Sides(*shape).inside(places, TriangleTarget(*shape).nearest(places))


def near(shape: Shape, spread: float, count: int = 4000) -> Floats:
    """Return places around a shape's surface."""
    rng = np.random.default_rng(4)
    shares = rng.dirichlet([1.0, 1.0, 1.0], count)
    corners = shape[0][shape[1][rng.integers(0, len(shape[1]), count)]]
    return (corners * shares[:, :, None]).sum(axis=1) + spread * rng.normal(size=(count, 3))


@pytest.mark.parametrize("spread", [0.01, 0.5])
@pytest.mark.parametrize("inside_out", [False, True])
def test_inside_of_a_ball(spread: float, inside_out: bool) -> None:
    vertices, triangles = ball(1000)
    places = near((vertices, triangles), spread)
    radius = np.linalg.norm(places, axis=1)
    clear = (radius > 1.0) | (radius < 0.985)  # the polyhedron's sides lie a little below the sphere
    found = inside((vertices, triangles[:, ::-1] if inside_out else triangles), places)
    assert (found[clear] == (radius < 1.0)[clear]).all()


def test_inside_of_two_boxes_that_intersect() -> None:
    """Where one lies in the other, both sides of its triangles are inside."""
    one, triangles = box()
    shape = np.concatenate([one, one + 0.6]), np.concatenate([triangles, triangles + 8])
    places = np.concatenate([near(shape, 0.02), near(shape, 0.3)])
    expected = (np.abs(places) < 0.5).all(axis=1) | (np.abs(places - 0.6) < 0.5).all(axis=1)
    assert (inside(shape, places) == expected).all()


@pytest.mark.parametrize("cut", [0.7, 0.8, 0.9, 0.95])
def test_a_hole_changes_nothing_away_from_it(cut: float) -> None:
    vertices, triangles = ball(1000)
    shape = vertices, triangles[vertices[triangles].mean(axis=1)[:, 2] < cut]
    places = near(shape, 0.1)
    radius = np.linalg.norm(places, axis=1)
    hole = np.sqrt(1.0 - cut**2)
    away = np.linalg.norm(places - [0.0, 0.0, cut], axis=1) > 2.0 * hole
    clear = away & ((radius > 1.0) | (radius < 0.985))
    assert (inside(shape, places)[clear] == (radius < 1.0)[clear]).all()


def test_behind_an_open_sheet_is_inside() -> None:
    axis = np.linspace(-1.0, 1.0, 21)
    x, y = (part.ravel() for part in np.meshgrid(axis, axis))
    corner = (np.arange(20)[:, None] * 21 + np.arange(20)).ravel()
    triangles = np.concatenate(
        [np.column_stack([corner, corner + 1, corner + 22]), np.column_stack([corner, corner + 22, corner + 21])]
    )
    places = np.random.default_rng(0).uniform(-0.8, 0.8, (2000, 3)) * [1.0, 1.0, 0.2]
    found = inside((np.column_stack([x, y, 0.0 * x]), triangles), places)
    assert (found == (places[:, 2] < 0.0)).all()

"""Nearest points against the formulas of simple bodies, brute force over dense places, and libigl."""

from __future__ import annotations

import numpy as np
import pytest
from distance_shapes import Shape, ball, box, soup
from sparse_surface.solver.distance.targets import PointTarget, TriangleTarget


@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "numpy"])
@pytest.mark.parametrize("shape", [box(), ball(2000), soup(3000, 0), soup(5, 1)], ids=["box", "ball", "soup", "few"])
@pytest.mark.parametrize("spread", [0.001, 0.1, 3.0, 1000.0])
def test_distances_are_those_of_libigl(shape: Shape, spread: float, compiled: bool) -> None:
    igl = pytest.importorskip("igl")
    vertices, triangles = shape
    rng = np.random.default_rng(3)
    some = vertices[rng.integers(0, len(vertices), 2000)] + spread * rng.normal(size=(2000, 3))
    squared = igl.point_mesh_squared_distance(some, vertices, triangles)[0]
    target = TriangleTarget(vertices, triangles, compiled=compiled)
    found = target.nearest(some)
    assert found.distance == pytest.approx(np.sqrt(squared), abs=2e-8, rel=1e-9)
    assert target.distance_to(some, found.element) == pytest.approx(found.distance, abs=2e-8, rel=1e-9)
    assert np.linalg.norm(found.foot - some, axis=1) == pytest.approx(found.distance, abs=1e-15)


@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "numpy"])
def test_distance_from_a_box_is_its_formula(compiled: bool) -> None:
    sides = np.array([1.0, 2.0, 0.5])
    vertices, triangles = box(tuple(sides))
    places = np.random.default_rng(0).uniform(-3.0, 3.0, (5000, 3))
    over = np.abs(places) - sides / 2.0
    outside = np.linalg.norm(np.maximum(over, 0.0), axis=1)
    expected = np.where((over < 0.0).all(axis=1), -over.max(axis=1), outside)
    target = TriangleTarget(vertices, triangles, compiled=compiled)
    found = target.nearest(places)
    assert found.distance == pytest.approx(expected, abs=1e-12)
    assert target.distance_to(places, found.element) == pytest.approx(expected, abs=1e-12)


def test_the_nearest_triangle_does_not_depend_on_what_was_searched_before() -> None:
    vertices, triangles = ball(2000)
    rng = np.random.default_rng(5)
    # corners, at which several triangles are equally near, and places around them
    places = np.concatenate([vertices[rng.integers(0, len(vertices), 300)], rng.normal(size=(300, 3))])
    target = TriangleTarget(vertices, triangles)
    together, order = target.nearest(places), rng.permutation(600)
    one_by_one = [target.nearest(places[k : k + 1]) for k in order]
    assert [int(found.element[0]) for found in one_by_one] == together.element[order].tolist()
    assert np.array_equal(np.concatenate([found.foot for found in one_by_one]), together.foot[order])


@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "numpy"])
@pytest.mark.parametrize("count", [1, 7, 8, 9, 65, 513])
def test_any_number_of_triangles_some_without_area(count: int, compiled: bool) -> None:
    rng = np.random.default_rng(count)
    corners = rng.normal(size=(count, 3, 3))
    corners[::4, 2] = 0.3 * corners[::4, 0] + 0.7 * corners[::4, 1]  # on the side between the others
    places = rng.normal(size=(50, 3))
    shares = rng.dirichlet([0.4, 0.4, 0.4], 4000)
    found = TriangleTarget(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), compiled=compiled)
    nearest = found.nearest(places)
    for place, distance, element in zip(places, nearest.distance, nearest.element, strict=True):
        dense = np.linalg.norm(shares @ corners - place, axis=-1)
        assert distance <= dense.min() + 1e-12
        assert distance == pytest.approx(dense[element].min(), abs=0.1)


def test_nearest_points_of_a_cloud() -> None:
    rng = np.random.default_rng(1)
    cloud, places = rng.normal(size=(300, 3)), rng.normal(size=(100, 3))
    expected = np.linalg.norm(places[:, None] - cloud, axis=2)
    found = PointTarget(cloud).nearest(places)
    assert found.distance == pytest.approx(expected.min(axis=1))
    assert (found.element == expected.argmin(axis=1)).all()


def test_the_normals_of_a_cloud_are_those_of_its_surface() -> None:
    places = ball(3000)[0]
    target = PointTarget(places)
    normals = target.normals(target.nearest(places))
    assert np.abs((normals * places).sum(axis=1)).min() > 0.999


def test_no_place_gives_no_distance() -> None:
    assert len(TriangleTarget(*box()).nearest(np.zeros((0, 3))).distance) == 0

"""Resampled surfaces against points evaluated one by one, exact shapes, and the rules of closed meshes."""

from __future__ import annotations

from collections import Counter
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from sparse_surface.benchmarks.generated_models import cube, moebius, tetrahedron
from sparse_surface.solver import InputError, Representation, Settings, approximate
from sparse_surface.solver.mesh.normals import triangle_areas
from sparse_surface.solver.surface.resampling import Resampled, resample, resample_steps

Array = NDArray[np.float64]
Faces = list[list[int]]

QUICK = Settings(ring=3, degree=4, sparsity=5, iterations=2, sweeps=0)


def mixed_plane() -> tuple[Array, Faces]:
    """A flat sheet of quads of both diagonals, triangles, a pentagon and a concave heptagon, with a loose vertex."""
    u, v = np.meshgrid(np.arange(7.0), np.arange(6.0), indexing="ij")
    points = np.stack([u, v, 0.5 * u - 0.25 * v], axis=-1).reshape(-1, 3)
    number = np.arange(42).reshape(7, 6)
    faces: Faces = []
    for i in range(6):
        for j in range(5):
            a, b, c, d = (int(number[i + p, j + q]) for p, q in ((0, 0), (1, 0), (1, 1), (0, 1)))
            if (i, j) in {(0, 0), (0, 1)}:
                continue
            faces += [[a, b, c], [a, c, d]] if (i + j) % 3 == 0 else [[b, c, d, a]]
    # the two cells left out, with a notch: a concave polygon of seven corners, and what fills the notch
    notch = [0.3, 1.0, 0.5 * 0.3 - 0.25]
    points = np.concatenate([points, [notch, [9.0, 9.0, 9.0]]])
    a, b, c, d, e, f = (int(number[i, j]) for i, j in ((0, 0), (1, 0), (1, 1), (1, 2), (0, 2), (0, 1)))
    faces += [[a, b, c, 42, d, e, f], [c, d, 42]]
    return points, faces


def folded() -> tuple[Array, Faces]:
    """A pentagon split along 0-2, beside a triangle whose edge runs from 0 to 2 as well, on another way."""
    angles = 2.0 * np.pi * np.arange(5) / 5
    rim = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    points = np.concatenate([rim, [[0.2, 0.2, 1.0]]])
    return points, [[0, 1, 2, 3, 4], [0, 2, 5]]


def quad_cube() -> tuple[Array, NDArray[np.int64]]:
    return cube(4)


MESHES = {
    "mixed plane": mixed_plane,
    "folded": folded,
    "cube": lambda: cube(4),
    "moebius": lambda: moebius(24, 4),
    "tetrahedron": tetrahedron,
}


@cache
def representation(name: str) -> Representation:
    vertices, faces = MESHES[name]()
    return approximate(vertices, faces, QUICK).representation


def triangles_of(mesh: Resampled) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Fans of the faces, and the face of each triangle; new faces are triangles and quads unless nothing was split."""
    fans = [(face[0], face[k], face[k + 1]) for face in mesh.polygons() for k in range(1, len(face) - 1)]
    return np.array(fans), np.repeat(np.arange(len(mesh.sizes)), mesh.sizes - 2)


def edge_counts(faces: list[NDArray[np.int64]] | Faces) -> Counter[tuple[int, int]]:
    return Counter(
        (min(int(a), int(b)), max(int(a), int(b)))
        for face in faces
        for a, b in zip(face, [*face[1:], face[0]], strict=True)
    )


def source_faces(surface: Representation) -> list[NDArray[np.int64]]:
    return np.split(surface.face_corners, surface.face_offsets[1:-1])


@pytest.mark.parametrize("splits", [1, 2, 3, 5])
@pytest.mark.parametrize("name", list(MESHES))
def test_every_point_is_that_of_the_surface(name: str, splits: int) -> None:
    """Each new face's corners are points of its own input face, evaluated there by hand."""
    surface = representation(name)
    mesh = resample(surface, splits)
    np.testing.assert_array_equal(mesh.vertices[: len(surface.vertices)], surface.at_vertices())
    inside = mesh.at_corners.weights[mesh.at_corners.place]
    corners = mesh.at_corners.sources[mesh.at_corners.place]
    own_face = np.repeat(mesh.source_face, mesh.sizes)
    np.testing.assert_array_equal(
        np.searchsorted(surface.face_offsets, corners, side="right") - 1, np.repeat(own_face[:, None], 3, axis=1)
    )
    by_corners = {
        (int(surface.polygon[t]), frozenset(surface.triangles[t].tolist())): t for t in range(len(surface.triangles))
    }
    for number in range(0, len(mesh.corners), max(1, len(mesh.corners) // 200)):
        vertices = surface.face_corners[corners[number]]
        triangle = by_corners[int(own_face[number]), frozenset(vertices.tolist())]
        order = [list(vertices).index(v) for v in surface.triangles[triangle]]
        point = surface.evaluate(np.array([triangle]), inside[number][order][None])[0]
        np.testing.assert_allclose(mesh.vertices[mesh.corners[number]], point, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("splits", [1, 2, 3, 5])
@pytest.mark.parametrize("name", list(MESHES))
def test_faces_are_split_without_gaps_or_turns(name: str, splits: int) -> None:
    """Back on the flat input, the parts of each face have its area and its normal."""
    surface = representation(name)
    mesh = resample(surface, splits)
    flat = mesh.at_vertices.linear(surface.vertices)
    np.testing.assert_array_equal(flat[: len(surface.vertices)], surface.vertices)
    triangles, face = triangles_of(mesh)
    own = mesh.source_face[face]
    assert (np.diff(mesh.source_face) >= 0).all()
    count = len(surface.face_offsets) - 1
    area = np.bincount(surface.polygon, triangle_areas(surface.vertices, surface.triangles), minlength=count)
    if splits > 1 or name != "mixed plane":  # a fan of a concave polygon covers some of it twice
        np.testing.assert_allclose(np.bincount(own, triangle_areas(flat, triangles), minlength=count), area, rtol=1e-9)
    directions = [
        area_vectors(points, corners) for points, corners in ((surface.vertices, surface.triangles), (flat, triangles))
    ]
    if name != "moebius":  # its quads are bent
        outwards = np.zeros((count, 3))
        np.add.at(outwards, surface.polygon, directions[0])
        if splits > 1:
            assert ((directions[1] * outwards[own]).sum(axis=1) > 0.0).all()


def area_vectors(points: Array, triangles: NDArray[np.int64]) -> Array:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


@pytest.mark.parametrize("splits", [2, 3, 4])
@pytest.mark.parametrize("name", list(MESHES))
def test_topology_is_that_of_the_input(name: str, splits: int) -> None:
    surface = representation(name)
    mesh = resample(surface, splits)
    before, after = edge_counts(source_faces(surface)), edge_counts(mesh.polygons())
    for uses in (1, 2):
        borders = [sum(1 for count in counts.values() if count == uses) for counts in (before, after)]
        if uses == 1:
            assert borders[1] == splits * borders[0]
    assert max(after.values()) <= 2
    used = len(set(mesh.corners.tolist()))
    loose = len(surface.vertices) - len(set(surface.face_corners.tolist()))
    assert len(mesh.vertices) == used + loose
    euler = [
        len(set(surface.face_corners.tolist())) - len(before) + len(surface.face_offsets) - 1,
        used - len(after) + len(mesh.sizes),
    ]
    assert euler[0] == euler[1]


def test_quads_stay_quads_and_other_faces_become_triangles() -> None:
    surface = representation("mixed plane")
    sizes = np.diff(surface.face_offsets)
    mesh = resample(surface, 3)
    for face, size in enumerate(sizes):
        new = mesh.sizes[mesh.source_face == face]
        assert set(new.tolist()) == {4 if size == 4 else 3}
        assert len(new) == (9 if size == 4 else 9 * (size - 2))


def test_with_one_part_faces_stay_as_they_are() -> None:
    for name in MESHES:
        surface = representation(name)
        mesh = resample(surface, 1)
        assert [sorted(face) for face in map(list, mesh.polygons())] == [
            sorted(f) for f in map(list, source_faces(surface))
        ]
        counted = edge_counts(mesh.polygons())
        assert counted == edge_counts(source_faces(surface))


def test_a_diagonal_is_not_the_edge_between_the_same_vertices() -> None:
    surface = representation("folded")
    ends = [set(triangle.tolist()) for triangle in surface.triangles]
    assert sum({0, 2} <= triangle for triangle in ends) >= 2
    mesh = resample(surface, 4)
    flat = mesh.at_vertices.linear(surface.vertices)
    inner = sum({0, 2} <= triangle for triangle in ends[:3]) // 2
    on_line = np.linalg.norm(np.cross(flat - flat[0], flat[2] - flat[0]), axis=1) < 1e-12
    assert on_line.sum() == 2 + 3 * (1 + inner)


@pytest.mark.parametrize("name", list(MESHES))
def test_chains_follow_the_edges(name: str) -> None:
    surface = representation(name)
    mesh = resample(surface, 4)
    flat = mesh.at_vertices.linear(surface.vertices)
    assert {tuple(edge) for edge in mesh.edges.tolist()} == set(edge_counts(source_faces(surface)))
    np.testing.assert_array_equal(mesh.chains[:, [0, -1]], mesh.edges)
    share = np.arange(5) / 4
    ends = surface.vertices[mesh.edges]
    expected = ends[:, :1] + share[:, None] * (ends[:, 1:] - ends[:, :1])
    np.testing.assert_allclose(flat[mesh.chains], expected, atol=1e-12)
    new_edges = edge_counts(mesh.polygons())
    for a, b in zip(mesh.chains[:, :-1].ravel(), mesh.chains[:, 1:].ravel(), strict=True):
        assert (min(int(a), int(b)), max(int(a), int(b))) in new_edges


def test_layers_of_corners_are_interpolated_in_their_own_face() -> None:
    """UV islands: every face has coordinates of its own, linear in its plane; a seam stays a seam."""
    surface = representation("mixed plane")
    face = np.repeat(np.arange(len(surface.face_offsets) - 1), np.diff(surface.face_offsets))
    uv = surface.vertices[surface.face_corners, :2] + 100.0 * face[:, None]
    mesh = resample(surface, 3)
    flat = mesh.at_vertices.linear(surface.vertices)
    expected = flat[mesh.corners, :2] + 100.0 * np.repeat(mesh.source_face, mesh.sizes)[:, None]
    np.testing.assert_allclose(mesh.at_corners.linear(uv), expected, atol=1e-9)
    np.testing.assert_array_equal(mesh.at_corners.nearest(face), np.repeat(mesh.source_face, mesh.sizes))


def test_layers_of_vertices_are_interpolated_or_taken_from_the_nearest() -> None:
    surface = representation("cube")
    mesh = resample(surface, 4)
    flat = mesh.at_vertices.linear(surface.vertices)
    np.testing.assert_allclose(mesh.at_vertices.linear(surface.vertices @ [1.0, 2.0, 3.0]), flat @ [1.0, 2.0, 3.0])
    nearest = mesh.at_vertices.nearest(surface.vertices)
    assert {tuple(row) for row in nearest} <= {tuple(row) for row in surface.vertices}
    assert np.linalg.norm(nearest - flat, axis=1).max() <= 0.25 * np.sqrt(2.0) / 2.0 * 1.34


@given(st.permutations(range(4)), st.integers(0, 3), st.integers(1, 4))
def test_quads_of_any_corner_order(order: list[int], turn: int, splits: int) -> None:
    """Quads with either diagonal, given as triangles that begin at any corner."""
    points = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    square = [order.index(k) for k in range(4)]  # corner k of the square is vertex square[k]
    halves = [[0, 1, 2], [0, 2, 3]] if order[0] % 2 else [[0, 1, 3], [1, 2, 3]]
    triangles = np.array([np.roll([square[k] for k in half], turn + n) for n, half in enumerate(halves)])
    surface = approximate(
        points[order], [square], QUICK, triangles=(triangles, np.zeros(2, dtype=np.int64)), weights=np.zeros(4)
    ).representation
    mesh = resample(surface, splits)
    x, y = np.meshgrid(2.0 * np.arange(splits + 1) / splits, np.arange(splits + 1) / splits)
    grid = np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1)
    assert len(mesh.vertices) == len(grid)
    distance = np.linalg.norm(mesh.vertices[:, None] - grid, axis=2)
    np.testing.assert_allclose(distance.min(axis=1), 0.0, atol=1e-12)
    np.testing.assert_array_equal(mesh.sizes, np.full(splits**2, 4))
    triangles, _ = triangles_of(mesh)
    np.testing.assert_allclose(area_vectors(mesh.vertices, triangles)[:, 2], 2.0 / splits**2, atol=1e-12)


def test_impossible_densities_are_refused() -> None:
    surface = representation("cube")
    for splits in (0, -3):
        with pytest.raises(InputError, match="1 part or more"):
            resample(surface, splits)
    with pytest.raises(InputError, match="fewer parts"):
        resample(surface, 100_000)


def test_it_tells_its_progress_and_can_be_stopped() -> None:
    steps = resample_steps(representation("cube"), 3)
    fractions = [step.fraction for step in steps]
    assert fractions
    assert fractions == sorted(fractions)
    steps = resample_steps(representation("cube"), 3)
    next(steps)
    steps.close()


@pytest.mark.parametrize("splits", [1.5, "2", None])
def test_parts_of_an_edge_are_a_whole_number(splits: object) -> None:
    surface = approximate(*cube(4), QUICK).representation
    with pytest.raises(InputError, match="whole number"):
        resample(surface, splits)  # type: ignore[arg-type]
    assert len(resample(surface, np.int64(2)).sizes) == 4 * (len(surface.face_offsets) - 1)

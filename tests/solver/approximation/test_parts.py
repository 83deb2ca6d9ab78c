"""Meshes that share borders: found, approximated as one, and given back part by part, at every density."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from numpy.typing import NDArray
from sparse_surface.solver import Settings, resample
from sparse_surface.solver.approximation.parts import joined, places_of_parts, taken_apart
from sparse_surface.solver.approximation.shared_borders import groups_of_parts
from sparse_surface.solver.interchange import MeshArrays
from sparse_surface.solver.job import approximate_arrays
from sparse_surface.solver.progress import run_to_end
from sparse_surface.solver.surface.resampling import Resampled

QUICK = Settings(ring=3, degree=5, sparsity=6, iterations=2, sweeps=1)
SIZE = 8


def box() -> tuple[NDArray[np.float32], list[NDArray[np.int32]]]:
    """A box of quads, bulged, and the quads of each of its sides."""
    places: dict[tuple[int, ...], int] = {}
    sides = []
    for axis in range(3):
        for end in (0, SIZE):
            quads = []
            for i in range(SIZE):
                for j in range(SIZE):
                    corners = []
                    for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
                        point = [0, 0, 0]
                        point[axis], point[(axis + 1) % 3], point[(axis + 2) % 3] = end, i + a, j + b
                        corners.append(places.setdefault(tuple(point), len(places)))
                    quads.append(corners if end else corners[::-1])
            sides.append(np.array(quads, dtype=np.int32))
    points = np.array(list(places), dtype=np.float64) / SIZE - 0.5
    points *= 1.0 + 0.3 * np.cos(2.0 * points[:, :1]) * np.cos(3.0 * points[:, 1:2])
    return points.astype(np.float32), sides


def arrays(points: NDArray[np.float32], quads: NDArray[np.int32], loose: int = 0) -> MeshArrays:
    """A mesh of some quads with its own copies of their vertices, and a few vertices without faces before them."""
    used = np.unique(quads)
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used)) + loose
    own = number[quads].astype(np.int32)
    vertices = np.concatenate([np.full((loose, 3), 0.1, np.float32), points[used]])
    triangles = own[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    polygons = np.repeat(np.arange(len(own), dtype=np.int32), 2)
    return MeshArrays(vertices, own.ravel(), np.full(len(own), 4, np.int32), (triangles, polygons))


def open_edges(meshes: list[tuple[NDArray[np.floating], list[NDArray[np.int64]]]]) -> int:
    """Edges that do not belong to two faces, where vertices at exactly one place are one."""
    places: dict[bytes, int] = {}
    count: Counter[tuple[int, int]] = Counter()
    for vertices, faces in meshes:
        number = [places.setdefault(vertex.tobytes(), len(places)) for vertex in vertices]
        for face in faces:
            for a, b in zip(face, np.roll(face, -1), strict=True):
                count[min(number[a], number[b]), max(number[a], number[b])] += 1
    return sum(times != 2 for times in count.values())


@pytest.fixture(scope="module")
def parts() -> list[MeshArrays]:
    points, sides = box()
    return [arrays(points, side, loose=number % 2) for number, side in enumerate(sides)]


def test_only_what_shares_a_border_belongs_together(parts: list[MeshArrays]) -> None:
    points, sides = box()
    far = arrays(points + np.float32(5.0), sides[0])
    corner = arrays(points + np.float32(points[:, 0].max() - points[:, 0].min()), np.concatenate(sides))
    assert groups_of_parts([far, *parts, corner], Settings()) == [[0], [1, 2, 3, 4, 5, 6], [7]]
    assert groups_of_parts([*parts[:2], *parts[2:]], Settings(merge_vertices=False)) == [[n] for n in range(6)]
    assert groups_of_parts([parts[3]], Settings()) == [[0]]
    # opposite sides share nothing until the one between them is there
    assert groups_of_parts([parts[0], parts[1]], Settings()) == [[0], [1]]
    assert groups_of_parts([parts[0], parts[1], parts[2]], Settings()) == [[0, 1, 2]]


@pytest.mark.parametrize("creases", ["off", "auto"])
def test_parts_close_as_before(parts: list[MeshArrays], creases: str) -> None:
    settings = Settings.from_dict({**QUICK.as_dict(), "creases": creases})
    whole = run_to_end(approximate_arrays(joined(parts), settings))
    names = [f"side {number}" for number in range(len(parts))]
    found = taken_apart(whole, parts, names)
    assert all(own.report["input"] == {**whole.report["input"], "parts": names} for own in found)
    given = [(mesh.vertices, list(mesh.corners.reshape(-1, 4))) for mesh in parts]
    after = [(own.vertices, list(mesh.corners.reshape(-1, 4))) for own, mesh in zip(found, parts, strict=True)]
    assert open_edges(given) == open_edges(after) == 0
    moved = np.concatenate([own.vertices for own in found])
    assert np.array_equal(moved, whole.vertices)
    assert not np.array_equal(moved, np.concatenate([mesh.vertices for mesh in parts]))
    assert np.array_equal(np.concatenate([own.domain_stretch for own in found]), whole.domain_stretch)
    places = places_of_parts(whole.representation, parts)
    for splits in (1, 3):
        fine = resample(whole.representation, splits)
        cut = [fine.part(part.faces, part.corners, part.place) for part in places]
        assert open_edges([(own.vertices, own.polygons()) for own, _ in cut]) == 0
        assert sum(len(own.sizes) for own, _ in cut) == len(fine.sizes)
        for mesh, (own, _), result, part in zip(parts, cut, found, places, strict=True):
            check_layers(mesh, own, splits)
            sorts = np.sort(np.unique(part.place, return_index=True)[1])
            assert own.vertices[: len(sorts)] == pytest.approx(result.vertices[sorts].astype(np.float64), abs=1e-6)


def check_layers(mesh: MeshArrays, own: Resampled, splits: int) -> None:
    """What vertices and corners carry is interpolated within the part: flat positions come out flat."""
    flat = own.at_vertices.linear(mesh.vertices.astype(np.float64))
    faces = own.polygons()
    corners = own.at_corners.linear(mesh.vertices[mesh.corners].astype(np.float64))
    assert corners == pytest.approx(flat[own.corners], abs=1e-7)
    assert np.array_equal(np.bincount(own.source_face), np.full(len(mesh.sizes), splits**2))
    quads = mesh.vertices[mesh.corners.reshape(-1, 4)].astype(np.float64)
    low, high = quads.min(axis=1) - 1e-6, quads.max(axis=1) + 1e-6
    for face, source in zip(faces, own.source_face, strict=True):
        assert ((flat[face] >= low[source]) & (flat[face] <= high[source])).all()
    sides = {tuple(sorted(pair)) for face in faces for pair in zip(face, np.roll(face, -1), strict=True)}
    parts = np.stack([own.chains[:, :-1], own.chains[:, 1:]], axis=2).reshape(-1, 2)
    assert {tuple(sorted(pair)) for pair in parts} <= sides
    assert {tuple(sorted(pair)) for pair in own.creases} <= sides
    assert len(own.edges) == 2 * SIZE * (SIZE + 1)

"""Strips along thin tubes and walls: few patches, small files, and creases of thin plates found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import Settings, approximate
from sparse_surface.solver.mesh.triangle_mesh import build_mesh
from sparse_surface.solver.patches.cover import build_cover
from sparse_surface.solver.patches.patches import build_patches

Mesh = tuple[np.ndarray, np.ndarray]


def washer(outside: int, inside: int, height: float = 0.1) -> Mesh:
    """A ring as a CAD program cuts it into triangles: long slivers between both circles, walls one quad high."""
    circles = []
    for count, radius in ((outside, 0.5), (inside, 0.25)):
        angle = 2 * np.pi * np.arange(count) / count
        circles.append(np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle], axis=1))
    bottom = np.concatenate(circles)
    vertices = np.concatenate([bottom, bottom + np.array([0.0, 0.0, height])])
    up, o, i = len(bottom), np.arange(outside), outside + np.arange(inside)
    faces: list[tuple[int, int, int]] = []
    for ring, turn in ((o, 1), (i, -1)):
        for a, b in zip(ring, np.roll(ring, -1), strict=True):
            faces += [(a, b, b + up)[::turn], (a, b + up, a + up)[::turn]]
    one = other = 0
    while one < outside or other < inside:
        if other == inside or (one < outside and (one + 1) * inside <= (other + 1) * outside):
            triangle = o[one % outside], o[(one + 1) % outside], i[other % inside]
            one += 1
        else:
            triangle = o[one % outside], i[(other + 1) % inside], i[other % inside]
            other += 1
        faces += [triangle[::-1], tuple(np.array(triangle) + up)]
    return vertices, np.array(faces)


def pin(sides: int) -> Mesh:
    """A long cylinder: a wall one quad high, and caps that are fans of slivers around one of their corners."""
    angle = 2 * np.pi * np.arange(sides) / sides
    circle = np.stack([0.05 * np.cos(angle), 0.05 * np.sin(angle), 0.0 * angle], axis=1)
    a = np.arange(sides)
    b = np.roll(a, -1)
    walls = [np.stack([a, b, b + sides], axis=1), np.stack([a, b + sides, a + sides], axis=1)]
    fan = np.stack([0 * a[1:-1], a[1:-1], b[1:-1]], axis=1)
    vertices = np.concatenate([circle, circle + np.array([0.0, 0.0, 2.0])])
    return vertices, np.concatenate([*walls, fan[:, ::-1], fan + sides])


def circles(*counts: int) -> set[tuple[int, int]]:
    """Edges of closed loops of this many vertices, one after the other."""
    edges, first = set(), 0
    for count in counts:
        edges |= {(min(a, b), max(a, b)) for k in range(count) for a, b in [(first + k, first + (k + 1) % count)]}
        first += count
    return edges


@pytest.mark.parametrize(("around", "most"), [(3, 6), (4, 5), (6, 4), (8, 5)])
def test_a_thin_tube_takes_a_few_strips_for_the_length_of_a_ring(around: int, most: int) -> None:
    mesh = build_mesh(*models.tube(around, 120))
    patches = build_patches(mesh, build_cover(mesh, 7), 7)
    assert not patches.passed_through.any()
    lengths = 120 / 13  # a ring of seven edges both ways
    assert 2 * lengths <= len(patches) <= most * lengths


@pytest.mark.parametrize("mesh", [washer(48, 48), washer(48, 32), washer(60, 40, 0.02)], ids=["even", "odd", "flat"])
def test_the_edges_of_a_washer_are_cut_and_its_file_is_no_larger_than_twice_the_mesh(
    mesh: Mesh, tmp_path: Path
) -> None:
    vertices, faces = mesh
    outside = int((np.linalg.norm(vertices[:, :2], axis=1) > 0.4).sum()) // 2
    inside = len(vertices) // 2 - outside
    result = approximate(vertices, faces, Settings(workers=1))
    assert {(int(a), int(b)) for a, b in result.representation.creases} == circles(outside, inside, outside, inside)
    assert result.report["patches"] <= len(vertices) / 5
    assert result.report["relative"]["surface_max"] < 0.002
    result.representation.save(tmp_path / "washer.npz")
    assert (tmp_path / "washer.npz").stat().st_size <= 2 * (12 * len(vertices) + 13 * len(faces))


@pytest.mark.parametrize("sides", [16, 25, 45])
def test_a_pin_is_cut_around_its_ends_and_not_along_its_wall(sides: int) -> None:
    result = approximate(*pin(sides), Settings(workers=1))
    assert {(int(a), int(b)) for a, b in result.representation.creases} == circles(sides, sides)
    assert result.report["patches"] <= 10


def test_a_rod_of_six_sides_may_mean_a_round_one() -> None:
    assert not len(approximate(*models.tube(6, 40), Settings(workers=1)).representation.creases)

"""Cutting meshes into blocks, and the shares by which blocks are blended."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import InputError, Settings
from sparse_surface.solver.blocks.cut import Cut, Parts
from sparse_surface.solver.blocks.large_mesh import LargeMesh
from sparse_surface.solver.blocks.shares import shares_of
from sparse_surface.solver.mesh.triangulation import triangulate


def neighbours(faces) -> list[set[int]]:
    """Vertices that share a face with each vertex, by the definition."""
    found: dict[int, set[int]] = {}
    for face in faces:
        for vertex in map(int, face):
            found.setdefault(vertex, set()).update(map(int, face))
    return [found.get(n, set()) - {n} for n in range(max(found) + 1)]


def walk(around: list[set[int]], sources) -> dict[int, int]:
    """Steps to each vertex that can be reached, one vertex at a time."""
    steps = {int(v): 0 for v in sources}
    ahead = deque(steps)
    while ahead:
        here = ahead.popleft()
        for there in around[here]:
            if there not in steps:
                steps[there] = steps[here] + 1
                ahead.append(there)
    return steps


@pytest.mark.parametrize("model", [models.cube(6), models.creased_terrain(900), models.thin_torus()])
def test_blocks_are_as_equal_as_can_be_and_hold_every_vertex_once(model) -> None:
    mesh = LargeMesh.of(*model)
    cut = Cut.of(mesh, 100)
    sizes = np.bincount(cut.block)
    assert len(cut) == -(-len(mesh.positions) // 100)
    assert sizes.max() <= 100
    assert np.ptp(sizes) <= len(cut)
    assert sorted(cut.order) == list(range(len(mesh.positions)))


def test_the_cut_does_not_depend_on_how_positions_are_stored() -> None:
    vertices, faces = models.creased_terrain(900)
    one = Cut.of(LargeMesh.of(vertices, faces), 200)
    other = Cut.of(LargeMesh.of(np.asfortranarray(vertices), faces), 200)
    assert (one.block == other.block).all()


@pytest.mark.parametrize("model", [models.cube(6), models.creased_terrain(900)])
def test_a_part_holds_what_is_some_steps_away(model) -> None:
    mesh, around = LargeMesh.of(*model), neighbours(model[1])
    cut = Cut.of(mesh, 150)
    parts = Parts(mesh, cut, 3)
    for number in range(len(cut)):
        part = parts.part(number)
        steps = walk(around, np.flatnonzero(cut.block == number))
        assert set(part.vertices) == {vertex for vertex, count in steps.items() if count <= 3}
        assert set(part.faces) == {n for n, face in enumerate(model[1]) if min(steps.get(int(v), 9) for v in face) <= 2}
        task = parts.task(number, part, Settings(), 2)
        assert (part.vertices[task.corners] == np.concatenate([model[1][n] for n in part.faces])).all()


def test_shares_are_one_in_sum_and_reach_as_far_as_they_should() -> None:
    model = models.creased_terrain(900)
    mesh, around = LargeMesh.of(*model), neighbours(model[1])
    cut, reach = Cut.of(mesh, 150), 3
    parts, total = Parts(mesh, cut, 2 * reach), np.zeros(len(mesh.positions))
    for number in range(len(cut)):
        part = parts.part(number)
        task = parts.task(number, part, Settings(), reach)
        share = shares_of(number, task.blocks, task.corners, task.offsets, reach)
        steps = walk(around, np.flatnonzero(cut.block == number))
        assert {int(v) for v in part.vertices[share > 0.0]} == {v for v, n in steps.items() if n <= reach}
        total[part.vertices] += share
    assert np.abs(total - 1.0).max() < 1e-15


def test_triangles_are_numbered_as_in_the_whole() -> None:
    vertices = np.random.default_rng(1).normal(size=(9, 3))
    faces = [[0, 1, 2, 3, 4], [2, 2, 5], [4, 3, 6], [6, 3, 7, 8]]
    mesh = LargeMesh.of(vertices, faces)
    corners, offsets = mesh.corners_of(np.arange(4))
    polygon = triangulate(vertices, corners, offsets)[1]
    first = mesh.triangle_offsets()
    assert first is not None
    assert mesh.triangle_count == len(polygon) == 6
    assert [int(np.flatnonzero(polygon == n)[0]) for n in (0, 2, 3)] == [int(first[n]) for n in (0, 2, 3)]


@pytest.mark.parametrize(
    ("vertices", "faces", "said"),
    [
        (np.zeros((3, 2)), [[0, 1, 2]], "three numbers each"),
        (np.full((3, 3), np.nan), np.array([[0, 1, 2]]), "Vertex 0 has a coordinate that is not a finite number"),
        (np.zeros((3, 3)), np.array([[0, 1, 3]]), "names vertex 3"),
        (np.zeros((3, 3)), np.zeros((0, 3), dtype=int), "no faces"),
        (np.zeros((3, 3)), np.array([[0, 1]]), "fewer than three corners"),
    ],
)
def test_what_is_no_mesh_is_refused(vertices, faces, said) -> None:
    with pytest.raises(InputError, match=said):
        LargeMesh.of(vertices, faces)

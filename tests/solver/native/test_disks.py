"""Rings of triangles and which of them are disks: the compiled kernel against NumPy's sparse matrices."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver.mesh.triangle_mesh import TriangleMesh, build_mesh, cut_along
from sparse_surface.solver.native.library import reason_against
from sparse_surface.solver.patches import cover, disks, patches
from sparse_surface.solver.patches.patches import Patches, build_patches

pytestmark = pytest.mark.skipif(reason_against() is not None, reason=str(reason_against()))


def grid(side: int, without: int = 0, seed: int = 0) -> TriangleMesh:
    """A plane from which some triangles were taken at random: holes, pinched vertices, loose pieces."""
    at = np.arange(side * side).reshape(side, side)
    a, b, c, d = (own.ravel() for own in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    rng = np.random.default_rng(seed)
    triangles = triangles[rng.permutation(len(triangles))[without:]]
    x, y = np.divmod(np.arange(side * side), side)
    return build_mesh(np.stack([x, y, 0.1 * rng.random(side * side)], axis=1), triangles)


def tube(around: int, along: int) -> TriangleMesh:
    angle, z = np.meshgrid(2 * np.pi * np.arange(around) / around, np.arange(along), indexing="xy")
    at = np.arange(around * along).reshape(along, around)
    a, b, c, d = (own.ravel() for own in (at[:-1], np.roll(at, -1, 1)[:-1], np.roll(at, -1, 1)[1:], at[1:]))
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return build_mesh(np.stack([np.cos(angle), np.sin(angle), z], axis=-1).reshape(-1, 3), triangles)


def three_wings() -> TriangleMesh:
    """Three planes that meet in a line: the mesh is cut there."""
    side, parts, faces = 9, [], []
    x, y = np.divmod(np.arange(side * side), side)
    at = np.arange(side * side).reshape(side, side)
    a, b, c, d = (own.ravel() for own in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
    own = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    for wing in range(3):
        angle = 2.0 * wing
        parts.append(np.stack([x * np.cos(angle), x * np.sin(angle), y], axis=1))
        faces.append(np.where(own < side, own, own + wing * side * side))
    return build_mesh(np.concatenate(parts), np.concatenate(faces))


def cut_cube() -> TriangleMesh:
    mesh = build_mesh(*models.cube())
    bend = np.abs(mesh.vertices[mesh.node_vertex[mesh.edges]]).max(axis=2).min(axis=1)
    return cut_along(mesh, bend >= np.abs(mesh.vertices).max() * (1 - 1e-9))


MESHES = {
    "plane": lambda: grid(20),
    "few holes": lambda: grid(20, 6, 1),
    "many holes": lambda: grid(20, 80, 2),
    "shreds": lambda: grid(16, 250, 3),
    "tube": lambda: tube(6, 30),
    "narrow tube": lambda: tube(3, 20),
    "cube": lambda: build_mesh(*models.cube()),
    "cut cube": cut_cube,
    "Moebius strip": lambda: build_mesh(*models.moebius()),
    "Klein bottle": lambda: build_mesh(*models.klein_bottle()),
    "pole": lambda: build_mesh(*models.pole(200, 4)),
    "three wings": three_wings,
    "sphere": lambda: build_mesh(*models.sphere()),
}


@pytest.fixture(params=MESHES)
def mesh(request: pytest.FixtureRequest) -> TriangleMesh:
    made: TriangleMesh = MESHES[request.param]()
    return made


def by_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (cover, disks, patches):
        monkeypatch.setattr(module, "reason_against", lambda: "The test compares with NumPy.")


def assert_same(one: Patches, other: Patches) -> None:
    for own in fields(Patches):
        np.testing.assert_array_equal(getattr(one, own.name), getattr(other, own.name), err_msg=own.name)


@pytest.mark.parametrize("ring", [1, 2, 4, 7])
def test_patches_are_those_of_numpy(mesh: TriangleMesh, ring: int, monkeypatch: pytest.MonkeyPatch) -> None:
    found = build_patches(mesh, cover.build_cover(mesh, ring), ring)
    by_numpy(monkeypatch)
    assert_same(found, build_patches(mesh, cover.build_cover(mesh, ring), ring))


@pytest.mark.parametrize("ring", [1, 3, 6])
def test_rings_around_all_nodes_are_those_of_numpy(
    mesh: TriangleMesh, ring: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    nodes = np.flatnonzero(mesh.used)
    limits = disks._Limits.of(mesh, ring)
    members = disks.ring_triangles(mesh, nodes, ring)
    found = disks._are_disks(mesh, limits, members), disks.held_nodes(mesh, members)
    by_numpy(monkeypatch)
    expected = disks.ring_triangles(mesh, nodes, ring)
    np.testing.assert_array_equal(members.indptr, expected.indptr)
    np.testing.assert_array_equal(members.indices, expected.indices)
    np.testing.assert_array_equal(found[0], disks._are_disks(mesh, limits, expected))
    np.testing.assert_array_equal(found[1], disks.held_nodes(mesh, expected))

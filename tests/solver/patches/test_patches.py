"""Patches against brute force: disks, cover, rims, repairs, and the loops around them."""

from __future__ import annotations

from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import ConvexHull
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver.errors import InputError
from sparse_surface.solver.mesh.triangle_mesh import TriangleMesh, build_mesh
from sparse_surface.solver.patches import disks
from sparse_surface.solver.patches.cover import build_cover
from sparse_surface.solver.patches.loops import boundary_loops
from sparse_surface.solver.patches.patches import Patches, build_patches, refine_patches

HARD = [
    models.tetrahedron,
    models.cube98,
    models.tube,
    models.thin_torus,
    models.moebius,
    models.klein_bottle,
    lambda: models.pole(300, 4),
    lambda: models.tube(3, 40),
]


def patches_of(mesh: TriangleMesh, ring: int = 7) -> Patches:
    return build_patches(mesh, build_cover(mesh, ring), ring)


def assert_sound(mesh: TriangleMesh, patches: Patches) -> None:
    """Check every patch, and all of them together, with nothing but sets."""
    outer, holes = boundary_loops(patches)
    assert outer.patch.tolist() == list(range(len(patches)))
    loops = defaultdict(list)
    for found in (outer, holes):
        for i, k in enumerate(found.patch.tolist()):
            loop = found.vertices[found.offsets[i] : found.offsets[i + 1]] - patches.vertex_offsets[k]
            loops[k].append(loop.tolist())
    fan_sizes = np.diff(mesh.fan_offsets)
    for k in range(len(patches)):
        rows = slice(patches.vertex_offsets[k], patches.vertex_offsets[k + 1])
        part = slice(patches.triangle_offsets[k], patches.triangle_offsets[k + 1])
        nodes, triangles = patches.nodes[rows], patches.triangles[part]
        np.testing.assert_array_equal(mesh.node_vertex[nodes], patches.vertices[rows])
        assert len(np.unique(nodes)) == len(nodes)
        np.testing.assert_array_equal(
            np.sort(nodes[triangles], axis=1), np.sort(mesh.nodes[patches.mesh_triangles[part]], axis=1)
        )
        assert_disk(len(nodes), triangles.tolist(), loops[k])
        rim = np.bincount(triangles.reshape(-1), minlength=len(nodes)) < fan_sizes[nodes]
        expected = steps_inwards(triangles.tolist(), rim)
        expected[patches.passed_through[patches.vertices[rows]]] = 0
        np.testing.assert_array_equal(patches.rim_distance[rows], expected)
    deepest = np.zeros(len(mesh.vertices), dtype=int)
    np.maximum.at(deepest, patches.vertices, patches.rim_distance)
    np.testing.assert_array_equal(deepest > 0, ~patches.passed_through)


def assert_disk(count: int, triangles: list[list[int]], loops: list[list[int]]) -> None:
    """One orientation, vertices with one fan each, and Euler's number of a disk with the given holes in it."""
    sides = [(t[i], t[(i + 1) % 3]) for t in triangles for i in range(3)]
    known = set(sides)
    assert len(known) == len(sides)
    edges = {tuple(sorted(side)) for side in sides}
    assert count - len(edges) + len(triangles) == 2 - len(loops)
    border = [(a, b) for a, b in sides if (b, a) not in known]
    in_loops = [(loop[i], loop[(i + 1) % len(loop)]) for loop in loops for i in range(len(loop))]
    assert sorted(border) == sorted(in_loops)
    assert len({a for a, _ in border}) == len(border)
    for loop in loops:
        assert loop[0] == min(loop)
    assert all(len(hole) < len(loops[0]) for hole in loops[1:])


def steps_inwards(triangles: list[list[int]], rim: np.ndarray) -> np.ndarray:
    neighbours = defaultdict(set)
    for t in triangles:
        for v in t:
            neighbours[v] |= set(t)
    distance = np.full(len(rim), -1)
    front, step = set(np.flatnonzero(rim).tolist()), 0
    while front:
        distance[list(front)] = step
        front = {n for v in front for n in neighbours[v] if distance[n] < 0}
        step += 1
    if not rim.any():
        distance[:] = 1
    return distance


# ------------------------------------------------------------------------------------------------- well-behaved meshes


@pytest.mark.parametrize(
    "model", [models.cube, models.cubetorus, models.lens, models.l_solid], ids=lambda m: m.__name__
)
@pytest.mark.parametrize("ring", [1, 3, 7])
def test_patches_are_disks_that_cover_all(model, ring):
    mesh = build_mesh(*model())
    patches = patches_of(mesh, ring)
    assert_sound(mesh, patches)
    assert not patches.passed_through.any()


def test_a_patch_is_the_ring_around_its_centre():
    mesh = build_mesh(*models.sphere(12))
    centres = build_cover(mesh, 5)
    patches = build_patches(mesh, centres, 5)
    np.testing.assert_array_equal(patches.centres, centres)
    hops = dijkstra(mesh.adjacency, indices=centres, unweighted=True)
    for k in range(len(patches)):
        vertices = patches.vertices[patches.vertex_offsets[k] : patches.vertex_offsets[k + 1]]
        np.testing.assert_array_equal(vertices, np.flatnonzero(hops[k] <= 5))
        inner = patches.rim_distance[patches.vertex_offsets[k] : patches.vertex_offsets[k + 1]] > 0
        assert inner[hops[k][vertices] <= 4].all()


def test_orientation_follows_the_mesh_on_closed_surfaces():
    vertices, faces = models.sphere(8)
    scrambled = np.where((np.arange(len(faces)) % 3 == 0)[:, None], faces[:, ::-1], faces)
    mesh = build_mesh(vertices, scrambled)
    patches = patches_of(mesh, 4)
    a, b, c = (vertices[patches.vertices[patches.block_triangles[:, i]]] for i in range(3))
    assert ((np.cross(b - a, c - a) * (a + b + c)).sum(axis=1) > 0).all()


def test_an_open_border_is_no_rim():
    vertices, faces = models.creased_terrain(36)
    mesh = build_mesh(vertices, faces)
    patches = patches_of(mesh, 20)
    assert len(patches) == 1
    assert (patches.rim_distance == 1).all()
    small = patches_of(mesh, 2)
    assert_sound(mesh, small)
    assert small.rim_distance[mesh.border[small.nodes]].max() > 0


def test_selecting_patches_keeps_each_as_it_is():
    mesh = build_mesh(*models.cube(8))
    patches = patches_of(mesh, 3)
    chosen = patches.select(np.array([4, 1]))
    for new, old in enumerate([4, 1]):
        for name, offsets in (
            ("vertices", "vertex_offsets"),
            ("rim_distance", "vertex_offsets"),
            ("triangles", "triangle_offsets"),
        ):
            one, two = (
                getattr(p, name)[getattr(p, offsets)[i] : getattr(p, offsets)[i + 1]]
                for p, i in ((chosen, new), (patches, old))
            )
            np.testing.assert_array_equal(one, two)
    assert len(patches.select(np.zeros(len(patches), dtype=bool))) == 0


# ---------------------------------------------------------------------------------------------------------- hard meshes


@pytest.mark.parametrize("model", HARD)
@pytest.mark.parametrize("ring", [1, 4, 7, 50])
def test_hard_models_are_covered_by_disks(model, ring):
    mesh = build_mesh(*model())
    patches = patches_of(mesh, ring)
    assert_sound(mesh, patches)
    assert not patches.passed_through.any()


@pytest.mark.parametrize("name", ["rocker-arm.obj", "teapot.obj", "beetle.obj"])
def test_hard_files_are_covered_by_disks(load_model, name):
    mesh = build_mesh(*load_model(name))
    patches = patches_of(mesh)
    assert_sound(mesh, patches)
    np.testing.assert_array_equal(patches.passed_through, mesh.passed_through)


def test_no_patch_wraps_a_closed_surface():
    mesh = build_mesh(*models.cube98())
    patches = patches_of(mesh, 50)
    assert np.diff(patches.triangle_offsets).max() <= len(mesh.triangles) / 2


def test_an_enclosed_gap_is_filled():
    """The ring around the foot of a long finger does not reach the tip."""
    mesh = build_mesh(*models.finger(9))
    foot, tip = np.array([7 * 16 + 7]), len(mesh.vertices) - 1
    patches = build_patches(mesh, foot, 7)
    assert patches.rings[0] == 7
    first = patches.vertices[: patches.vertex_offsets[1]]
    hops = dijkstra(mesh.adjacency, indices=foot[0], unweighted=True)
    assert hops[tip] > 7
    assert tip in first
    assert_sound(mesh, patches)


def test_what_goes_on_beyond_a_patch_is_no_gap():
    """A narrow tail is as small as a gap in the neighbourhood of the patch, but leads out of it."""
    vertices, faces = models.finger(9, 5)
    tail = np.array([[-step, row, 0.0] for step in range(1, 21) for row in (2.0, 3.0)])
    ends = np.concatenate([[[2 * 6, 3 * 6]], len(vertices) + np.arange(40).reshape(20, 2)])
    quads = np.stack([ends[:-1, 0], ends[:-1, 1], ends[1:, 1], ends[1:, 0]], axis=1)
    mesh = build_mesh(np.concatenate([vertices, tail]), np.concatenate([faces, quads]))
    centre = 2 * 6 + 2
    patches = build_patches(mesh, np.array([centre]), 7)
    first = patches.vertices[: patches.vertex_offsets[1]]
    assert len(vertices) - 1 in first  # the finger's tip
    hops = dijkstra(mesh.adjacency, indices=centre, unweighted=True)
    assert hops[first[first >= len(vertices)]].max() == 7


@pytest.mark.parametrize("missing", [1, 6])
def test_a_small_hole_in_a_scan_is_no_obstacle(missing):
    vertices, faces = models.creased_terrain(900)
    star = (faces == 15 * 30 + 15).any(axis=1)
    gone = np.flatnonzero(star)[: None if missing == 6 else 1]
    mesh = build_mesh(vertices, np.delete(faces, gone, axis=0))
    patches = patches_of(mesh)
    assert_sound(mesh, patches)
    assert patches.rings.min() >= 6  # smaller only where the outer boundary would touch the hole
    assert len(boundary_loops(patches)[1].patch) > 0


def test_the_end_of_a_tube_is_no_small_hole():
    mesh = build_mesh(*models.tube(6, 60))
    patches = patches_of(mesh)
    assert len(boundary_loops(patches)[1].patch) == 0


def test_patches_do_not_cross_a_cut():
    vertices, faces = models.tetrahedron()
    both = np.concatenate((vertices, vertices[1:] + 2 * (vertices[0] - vertices[1:])))
    mesh = build_mesh(both, np.concatenate((faces, np.where(faces == 0, 0, faces + 3)[:, ::-1])))
    patches = patches_of(mesh)
    assert_sound(mesh, patches)
    assert np.flatnonzero(patches.passed_through).tolist() == [0]
    for k in range(len(patches)):
        nodes = patches.nodes[patches.vertex_offsets[k] : patches.vertex_offsets[k + 1]]
        assert len(np.unique(mesh.component[nodes])) == 1


def test_what_cannot_be_a_disk_is_passed_through():
    pillow = build_mesh([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 1]])
    patches = patches_of(pillow)
    assert len(patches) == 0
    assert patches.passed_through.all()


def test_a_pole_of_two_thousand_triangles():
    mesh = build_mesh(*models.pole(2000, 3))
    patches = patches_of(mesh)
    assert not patches.passed_through.any()
    assert np.diff(patches.triangle_offsets).max() <= 20_000


@given(arrays(np.int64, st.tuples(st.integers(1, 60), st.just(3)), elements=st.integers(0, 14)), st.integers(1, 8))
def test_any_soup_of_triangles_is_covered_or_passed_through(faces, ring):
    points = np.random.default_rng(0).normal(size=(15, 3))
    try:
        mesh = build_mesh(points, faces)
    except InputError:
        return
    assert_sound(mesh, patches_of(mesh, ring))


@given(st.integers(0, 2**32 - 1), st.integers(8, 150), st.integers(1, 8), st.integers(0, 4))
def test_any_closed_surface_with_damage(seed, count, ring, damage):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    faces = ConvexHull(points).simplices.astype(np.int64)
    faces = np.delete(faces, rng.integers(0, len(faces), damage), axis=0)
    faces = np.concatenate((faces, rng.integers(0, count, (damage, 3))))
    mesh = build_mesh(points, faces)
    assert_sound(mesh, patches_of(mesh, ring))


# --------------------------------------------------------------------------------------------------------- refinement


@pytest.mark.parametrize("ring", [1, 3, 4])
def test_refined_patches_hold_what_the_old_ones_held(ring):
    mesh = build_mesh(*models.cubetorus())
    patches = patches_of(mesh)
    which = np.array([3, 11])
    refined, new = refine_patches(mesh, patches, which, ring)
    assert_sound(mesh, refined)
    assert not refined.passed_through.any()
    kept = np.setdiff1d(np.arange(len(patches)), which)
    np.testing.assert_array_equal(refined.centres[~new], patches.centres[kept])
    np.testing.assert_array_equal(refined.select(~new).vertices, patches.select(kept).vertices)
    assert new.sum() > len(which)
    assert refined.rings[new].max() <= ring
    old = np.unique(patches.select(which).vertices)
    assert np.isin(refined.centres[new], old).all()


def test_refining_all_or_nothing():
    mesh = build_mesh(*models.cube(8))
    patches = patches_of(mesh)
    same, new = refine_patches(mesh, patches, np.zeros(len(patches), dtype=bool), 3)
    assert not new.any()
    np.testing.assert_array_equal(same.vertices, patches.vertices)
    all_new, new = refine_patches(mesh, patches, np.ones(len(patches), dtype=bool), 3)
    assert new.all()
    assert_sound(mesh, all_new)


@pytest.mark.parametrize("model", [*HARD, lambda: models.creased_terrain(4000)])
def test_patches_are_the_same_whatever_threads_build_them(model, monkeypatch):
    mesh, ring = build_mesh(*model()), 3
    alone = patches_of(mesh, ring)
    monkeypatch.setattr(disks, "_LEAST", 5)
    with ThreadPoolExecutor(3) as threads:
        found = build_patches(mesh, build_cover(mesh, ring), ring, each=threads.map)
    for name, expected in vars(alone).items():
        np.testing.assert_array_equal(getattr(found, name), expected, err_msg=name)

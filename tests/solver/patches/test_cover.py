"""Covers against hop distances from scipy's own graph search, and the paper's counts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver.mesh.triangle_mesh import TriangleMesh, build_mesh
from sparse_surface.solver.patches.cover import build_cover, hops_from


def hops(mesh: TriangleMesh, sources: np.ndarray) -> np.ndarray:
    return dijkstra(mesh.adjacency, indices=sources, unweighted=True)


def split_sphere() -> TriangleMesh:
    """Two spheres and a loose vertex."""
    vertices, faces = models.sphere(6)
    count = len(vertices)
    return build_mesh(
        np.concatenate((vertices, vertices + 5, [[9.0, 9, 9]])), np.concatenate((faces, faces[:, ::-1] + count))
    )


@pytest.mark.parametrize("model", [models.cube, models.moebius, models.tube, models.lens], ids=lambda m: m.__name__)
@pytest.mark.parametrize("ring", [1, 2, 7, 50])
def test_every_vertex_lies_well_inside_a_ring(model, ring):
    mesh = build_mesh(*model())
    assert hops(mesh, build_cover(mesh, ring)).min(axis=0).max() <= ring - 1


@pytest.mark.parametrize("model", [models.cube, models.lens, models.tube], ids=lambda m: m.__name__)
def test_each_centre_is_a_farthest_point(model):
    mesh = build_mesh(*model())
    centres = build_cover(mesh, 5)
    each = hops(mesh, centres)
    field = each[0]
    for number, centre in enumerate(centres[1:], start=1):
        assert field[centre] == field.max()
        field = np.minimum(field, each[number])
    assert len(np.unique(centres)) == len(centres)


def test_hops_agree_with_a_graph_search():
    mesh = split_sphere()
    sources = np.array([3, 77])
    expected = hops(mesh, sources).min(axis=0)
    found = hops_from(mesh, sources)
    reached = np.isfinite(expected)
    np.testing.assert_array_equal(found[reached], expected[reached])
    assert (found[~reached] > 10**9).all()


def test_a_components_first_centre_is_farthest_from_its_first_vertex():
    mesh = split_sphere()
    centres = build_cover(mesh, 50)  # one for each of the two spheres
    for nodes in (np.arange(mesh.node_count // 2), np.arange(mesh.node_count // 2, mesh.node_count - 1)):
        (centre,) = centres[np.isin(centres, nodes)]
        distance = hops(mesh, nodes[0])
        assert distance[centre] == distance[nodes].max()


@pytest.mark.parametrize("ring", [1, 2, 3, 7])
def test_the_patches_round_a_pole_do_not_grow_with_its_square(ring):
    """A patch that reaches the pole of a fan holds all of it; the fan's other patches are few or small."""

    def triangles_in_patches(n):
        rim = 1 + np.arange(n)
        fan = np.column_stack([np.zeros(n, dtype=int), rim, np.roll(rim, -1)])
        turn = 2.0 * np.pi * np.arange(n) / n
        circle = np.column_stack([np.cos(turn), np.sin(turn), 0.1 * np.cos(5.0 * turn)])
        mesh = build_mesh(np.vstack([[0.0, 0.0, 1.0], circle]), fan)
        everywhere = np.ones(n + 1, dtype=bool)
        reached = [hops_from(mesh, centre[None]) <= ring for centre in build_cover(mesh, ring, everywhere)]
        return sum(int(inside[mesh.triangles].all(axis=1).sum()) for inside in reached)

    assert triangles_in_patches(800) <= 2 * triangles_in_patches(400) + 10


def test_each_component_has_a_centre_and_loose_vertices_have_none():
    mesh = split_sphere()
    centres = build_cover(mesh, 50)
    assert sorted(mesh.component[centres].tolist()) == sorted(set(mesh.component[mesh.used].tolist()))


def test_only_what_is_wanted_is_covered():
    mesh = split_sphere()
    wanted = np.zeros(mesh.node_count, dtype=bool)
    assert len(build_cover(mesh, 3, wanted)) == 0
    wanted[:40] = True
    centres = build_cover(mesh, 3, wanted)
    assert wanted[centres].all()
    assert hops(mesh, centres).min(axis=0)[wanted].max() <= 2


def test_position_and_size_make_no_difference():
    vertices, faces = models.cubetorus()
    turned = vertices @ np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0] * 1e3 + 7.0
    mesh = build_mesh(vertices, faces)
    triangulation = (mesh.triangles, mesh.polygon)
    centres = build_cover(mesh, 7)
    np.testing.assert_array_equal(centres, build_cover(build_mesh(turned, faces, triangulation), 7))
    np.testing.assert_array_equal(centres, build_cover(mesh, 7))


@pytest.mark.parametrize(
    ("name", "printed", "tolerance"),
    [
        ("cube", 26, 0.25),
        ("cubetorus", 40, 0.15),
        ("cylinder", 39, 0.15),
        ("flower", 97, 0.15),
        ("detailed", 882, 0.15),
    ],
)
def test_counts_are_near_those_of_table_1(name, printed, tolerance):
    count = len(build_cover(build_mesh(*models.MODELS[name]()), 7))
    assert abs(count - printed) <= tolerance * printed


@pytest.mark.parametrize(("name", "printed"), [("fandisk.obj", 88), ("stanford-bunny.ply", 551)])
def test_counts_on_the_papers_own_models(load_model, name, printed):
    count = len(build_cover(build_mesh(*load_model(name)), 7))
    assert abs(count - printed) <= 0.15 * printed

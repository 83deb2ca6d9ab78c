"""Covers, conformal maps and connected parts of the compiled kernel against those of NumPy and SciPy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver.mesh.triangle_mesh import TriangleMesh, build_mesh
from sparse_surface.solver.native import graphs, library, maps
from sparse_surface.solver.patches import cover, parameterisation
from sparse_surface.solver.patches.patches import build_patches

pytestmark = pytest.mark.skipif(library.reason_against() is not None, reason=str(library.reason_against()))

MODELS = [models.cube, models.moebius, models.tube, models.lens, models.finger, models.flower]


def without_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (cover, parameterisation):
        monkeypatch.setattr(module, "reason_against", lambda: "the test asks for NumPy")


def separate_pieces() -> TriangleMesh:
    """Two spheres and a loose vertex."""
    vertices, faces = models.sphere(5)
    both = np.concatenate((vertices, vertices + 5.0, [[9.0, 9.0, 9.0]]))
    return build_mesh(both, np.concatenate((faces, faces + len(vertices))))


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
@pytest.mark.parametrize("ring", [1, 2, 7, 50])
def test_centres_are_those_of_numpy_in_the_same_order(
    monkeypatch: pytest.MonkeyPatch, model: Callable[[], models.Model], ring: int
) -> None:
    mesh = build_mesh(*model())
    rng = np.random.default_rng(ring)
    some = rng.random(mesh.node_count) < 0.3
    found = [cover.build_cover(mesh, ring), cover.build_cover(mesh, ring, some)]
    without_kernel(monkeypatch)
    for centres, wanted in zip(found, (None, some), strict=True):
        np.testing.assert_array_equal(centres, cover.build_cover(mesh, ring, wanted))


def test_long_ways_are_covered_one_centre_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond 32 hops, as along a tube of 400 rings."""
    mesh = build_mesh(*models.tube(6, 400))
    found = cover.build_cover(mesh, 3)
    without_kernel(monkeypatch)
    np.testing.assert_array_equal(found, cover.build_cover(mesh, 3))


def test_hops_in_separate_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = separate_pieces()
    sources = np.array([3, 3, 40])
    found = cover.hops_from(mesh, sources)
    assert found.max() > mesh.node_count, "the second sphere cannot be reached"
    without_kernel(monkeypatch)
    np.testing.assert_array_equal(found, cover.hops_from(mesh, sources))


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_maps_are_those_of_numpy(monkeypatch: pytest.MonkeyPatch, model: Callable[[], models.Model]) -> None:
    mesh = build_mesh(*model())
    disks = build_patches(mesh, cover.build_cover(mesh, 7), 7)
    found = parameterisation.solve_initial_domains(mesh, disks)
    without_kernel(monkeypatch)
    expected = parameterisation.solve_initial_domains(mesh, disks)
    np.testing.assert_array_equal(found.method, expected.method)
    np.testing.assert_allclose(found.points, expected.points, atol=1e-9 * np.ptp(expected.points))


def fan(blades: int) -> maps.Disks:
    """A regular fan of triangles around a vertex, flat."""
    angle = 2.0 * np.pi * np.arange(blades) / blades
    around = np.stack((np.cos(angle), np.sin(angle), np.zeros(blades)), axis=1)
    positions = np.concatenate(([[0.0, 0.0, 0.0]], around))
    triangles = np.stack((np.zeros(blades), 1 + np.arange(blades), 1 + (1 + np.arange(blades)) % blades), axis=1)
    corners = positions[triangles.astype(np.int64)]
    lengths = np.linalg.norm(corners[:, [1, 2, 0]] - corners[:, [2, 0, 1]], axis=2)
    areas = np.full(blades, 0.5 * np.sin(2.0 * np.pi / blades))
    offsets = np.array([0, blades + 1]), np.array([0, blades])
    return maps.Disks(offsets[0], positions, offsets[1], triangles.astype(np.int64), lengths, areas)


def test_what_is_flat_keeps_its_shape() -> None:
    disk = fan(9)
    points, solved = maps.conformal_maps(disk)
    assert solved.all()
    apart = [np.linalg.norm(own[:, None] - own[None], axis=2) for own in (points, disk.positions)]
    np.testing.assert_allclose(apart[0], apart[1], atol=1e-12)


def test_what_cannot_be_solved_is_left_alone_and_mapped_by_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = fan(9)._replace(areas=np.full(9, -1.0))
    points, solved = maps.conformal_maps(wrong)
    assert not solved.any()
    assert not points.any()

    mesh = build_mesh(*models.cube())
    disks = build_patches(mesh, cover.build_cover(mesh, 7), 7)
    expected = parameterisation.initial_domains(mesh, disks)

    def but_every_third(given: maps.Disks) -> tuple[np.ndarray, np.ndarray]:
        points, solved = conformal_maps(given)
        solved[::3] = False
        points[np.repeat(~solved, np.diff(given.vertex_offsets))] = np.nan
        return points, solved

    conformal_maps = maps.conformal_maps
    monkeypatch.setattr(maps, "conformal_maps", but_every_third)
    np.testing.assert_allclose(parameterisation.initial_domains(mesh, disks), expected, atol=1e-9)


@pytest.mark.parametrize("edges", [0, 10, 300, 3000])
def test_connected_parts_are_those_of_scipy_by_their_lowest_nodes(edges: int) -> None:
    one, other = np.random.default_rng(edges).integers(0, 1000, (2, edges))
    count, part = graphs.connected_parts(one, other, 1000)
    found, label = connected_components(coo_array((np.ones(edges), (one, other)), shape=(1000, 1000)), directed=False)
    assert count == found
    assert len(np.unique(np.stack((part, label)), axis=1).T) == count, "the same nodes belong together"
    lowest = np.unique(part, return_index=True)[1]
    assert (np.diff(lowest) > 0).all()


def test_a_long_path_is_one_part_from_either_end() -> None:
    along = np.arange(100_000)
    for order in (slice(None), slice(None, None, -1)):
        count, part = graphs.connected_parts(along[:-1][order], along[1:][order], 100_000)
        assert count == 1
        assert not part.any()


@pytest.mark.parametrize("largest", [0, 1, 2047, 2048, 10**12, 2**62])
@pytest.mark.parametrize("count", [0, 1, 5000])
def test_orders_are_those_of_numpy(count: int, largest: int) -> None:
    numbers = np.random.default_rng(1).integers(0, largest, size=count, endpoint=True)
    numbers[::3] = numbers[:1].sum()  # equal ones, which stay as they come
    for own in (numbers, np.sort(numbers), np.sort(numbers)[::-1]):
        np.testing.assert_array_equal(graphs.stable_order(own), np.argsort(own, kind="stable"))

"""The fair surface beside a mesh: against its energy, written down plainly, and known shapes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from sparse_surface.benchmarks.generated_models import cube, cylinder, sphere
from sparse_surface.solver.mesh import fairing
from sparse_surface.solver.mesh.curved import curved_offsets, node_normals, offsets_inside
from sparse_surface.solver.mesh.fairing import fair_offsets
from sparse_surface.solver.mesh.normals import face_normals, unit
from sparse_surface.solver.mesh.sampling import low_discrepancy
from sparse_surface.solver.mesh.triangle_mesh import TriangleMesh, build_mesh

Array = NDArray[np.float64]
SAMPLES = low_discrepancy(200)


def rough_sphere(roughness: float) -> TriangleMesh:
    vertices, faces = sphere(12)
    away = np.random.default_rng(3).normal(size=len(vertices)) * roughness
    return build_mesh(vertices * (1.0 + away)[:, None], faces)


def on(mesh: TriangleMesh, offsets: tuple[Array, Array], samples: Array = SAMPLES) -> Array:
    """The surface at samples of the triangles, (T, q, 3)."""
    flat = np.einsum("qk,tkd->tqd", samples, mesh.vertices[mesh.triangles])
    return flat + offsets_inside(mesh.nodes, *offsets, samples)


def normals_on(mesh: TriangleMesh, offsets: tuple[Array, Array]) -> Array:
    step = 1e-5
    here, right, up = (on(mesh, offsets, SAMPLES + step * np.array(way)) for way in ([0, 0, 0], [-1, 1, 0], [-1, 0, 1]))
    return unit(np.cross(right - here, up - here))


def before(mesh: TriangleMesh) -> tuple[Array, Array]:
    moves, bulges = curved_offsets(mesh)
    return fairing.CURVED_SHARE * moves, fairing.CURVED_SHARE * bulges


def off_normals(mesh: TriangleMesh, offsets: tuple[Array, Array]) -> Array:
    """Mean square over each triangle of the surface's normals less those between its corners, (T,)."""
    wanted = unit(np.einsum("qk,tkd->tqd", SAMPLES, node_normals(mesh)[mesh.nodes]))
    return ((normals_on(mesh, offsets) - wanted) ** 2).sum(axis=2).mean(axis=1)


def energy(mesh: TriangleMesh, offsets: tuple[Array, Array]) -> float:
    """The energy of the module's text for a mesh that is wound outwards, by sampling, with true normals."""
    corners = mesh.vertices[mesh.triangles]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    own, flat = node_normals(mesh)[mesh.nodes], face_normals(mesh.vertices, mesh.triangles)
    angle = np.degrees(np.arccos(np.einsum("tkd,td->tk", own, flat).min(axis=1)))
    rough = off_normals(mesh, before(mesh))
    sure = np.clip(1.0 - (angle / fairing.UNSURE) ** 2, 0.0, None) ** 2
    share = rough / (rough + np.radians(fairing.ROUGH) ** 2) * sure
    moved = ((on(mesh, offsets) - on(mesh, before(mesh))) ** 2).sum(axis=2).mean(axis=1)
    return float((moved + fairing.SMOOTHNESS * area * share * off_normals(mesh, offsets)).sum())


def test_no_surface_near_it_has_less_energy() -> None:
    mesh = rough_sphere(0.003)
    moves, bulges = fair_offsets(mesh)
    least, around = energy(mesh, (moves, bulges)), node_normals(mesh)
    random = np.random.default_rng(5)
    first = before(mesh)
    assert least < 0.9 * energy(mesh, first)
    for _ in range(3):
        size = 0.2 * np.abs(moves - first[0]).max()
        other = moves + size * random.normal(size=len(moves))[:, None] * around
        assert least < energy(mesh, (other, bulges))
    # linear to first order only: a little more or less of everything hardly gains
    for share in (0.9, 1.1):
        one, two = (old + share * (new - old) for old, new in zip(first, (moves, bulges), strict=True))
        assert least < 1.002 * energy(mesh, (one, two))


def test_a_smooth_shape_keeps_the_curved_surface() -> None:
    mesh = build_mesh(*sphere(16))
    for fair, curved in zip(fair_offsets(mesh), before(mesh), strict=True):
        assert np.abs(fair - curved).max() < 0.1 * np.abs(curved).max()


def test_roughness_ripples_less_than_the_curved_surface() -> None:
    mesh = rough_sphere(0.004)
    fair, curved = (np.sqrt(off_normals(mesh, found).mean()) for found in (fair_offsets(mesh), before(mesh)))
    assert fair < 0.8 * curved


def test_size_and_place_do_not_matter() -> None:
    mesh = rough_sphere(0.002)
    moves, bulges = fair_offsets(mesh)
    turn = np.linalg.qr(np.random.default_rng(7).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    other = build_mesh(1e3 * mesh.vertices @ turn.T + 50.0, mesh.triangles)
    moves_too, bulges_too = fair_offsets(other)
    size = np.abs(moves).max()
    np.testing.assert_allclose(moves_too / 1e3, moves @ turn.T, atol=1e-6 * size)
    np.testing.assert_allclose(bulges_too / 1e3, bulges @ turn.T, atol=1e-6 * size)


@pytest.mark.parametrize("turned", [slice(0, None, 3), slice(None)])
def test_the_winding_of_the_input_does_not_matter(turned: slice) -> None:
    vertices, faces = sphere(6)
    other = faces.copy()
    other[turned] = other[turned][:, ::-1]
    (moves, bulges), (moves_too, bulges_too) = (fair_offsets(build_mesh(vertices, own)) for own in (faces, other))
    np.testing.assert_allclose(moves_too, moves, atol=1e-9)
    np.testing.assert_allclose(bulges_too.sum(axis=1), bulges.sum(axis=1), atol=1e-9)
    assert np.abs(moves).max() > 1e-3


def test_flat_sides_and_steep_edges_stay() -> None:
    for part in fair_offsets(build_mesh(*cube(6))):
        assert np.abs(part).max() < 1e-12


def test_triangles_at_a_steep_edge_do_not_speak_of_normals() -> None:
    """Uncut, a rim's normals lie between both sides: they would round it off."""
    mesh = build_mesh(*cylinder())
    rim = np.isclose(np.abs(mesh.vertices[:, 2]), np.abs(mesh.vertices[:, 2]).max())
    moves, _ = fair_offsets(mesh)
    side = np.ptp(mesh.vertices, axis=0).max()
    assert np.linalg.norm(moves[rim], axis=1).max() < 1e-3 * side


def test_triangles_without_area_and_loose_vertices_stay_finite() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0], [5, 5, 5]])
    for part in fair_offsets(build_mesh(vertices, np.array([[0, 1, 2], [0, 3, 1]]))):
        assert np.isfinite(part).all()

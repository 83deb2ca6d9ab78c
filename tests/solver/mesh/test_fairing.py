"""The fair surface beside a mesh: against its energy, written down plainly, and known shapes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_array
from sparse_surface.benchmarks.generated_models import cube, cylinder, sphere
from sparse_surface.solver.mesh import fairing
from sparse_surface.solver.mesh.curved import curved_offsets, node_normals, offsets_inside
from sparse_surface.solver.mesh.fairing import fair_offsets
from sparse_surface.solver.mesh.normals import unit
from sparse_surface.solver.mesh.sampling import low_discrepancy
from sparse_surface.solver.mesh.triangle_mesh import TriangleMesh, build_mesh

Array = NDArray[np.float64]
SAMPLES = low_discrepancy(60)


def rough_sphere(roughness: float) -> TriangleMesh:
    vertices, faces = sphere(12)
    away = np.random.default_rng(3).normal(size=len(vertices)) * roughness
    return build_mesh(vertices * (1.0 + away)[:, None], faces)


def on(mesh: TriangleMesh, offsets: tuple[Array, Array], samples: Array = SAMPLES) -> Array:
    """The surface at samples of the triangles, (T, q, 3)."""
    flat = np.einsum("qk,tkd->tqd", samples, mesh.vertices[mesh.triangles])
    return flat + offsets_inside(mesh.nodes, *offsets, samples)


def normals_on(mesh: TriangleMesh, offsets: tuple[Array, Array], samples: Array = SAMPLES) -> Array:
    step = 1e-5
    here, right, up = (on(mesh, offsets, samples + step * np.array(way)) for way in ([0, 0, 0], [-1, 1, 0], [-1, 0, 1]))
    return unit(np.cross(right - here, up - here))


def flat(mesh: TriangleMesh) -> tuple[Array, Array]:
    return np.zeros((mesh.node_count, 3)), np.zeros((len(mesh.triangles), 3, 3))


def off_normals(mesh: TriangleMesh, offsets: tuple[Array, Array], around: Array | None = None) -> Array:
    """Mean square over each triangle of the surface's normals less those between its corners, (T,)."""
    around = node_normals(mesh) if around is None else around
    wanted = unit(np.einsum("qk,tkd->tqd", SAMPLES, around[mesh.nodes]))
    return ((normals_on(mesh, offsets) - wanted) ** 2).sum(axis=2).mean(axis=1)


def averages(mesh: TriangleMesh) -> tuple[csr_array, csr_array]:
    """Matrices from nodes to sums over the corners of triangles, and from triangles to means around nodes."""
    rows = np.repeat(np.arange(len(mesh.triangles)), 3)
    at = csr_array((np.ones(len(rows)), (rows, mesh.nodes.ravel())), shape=(len(mesh.triangles), mesh.node_count))
    return at, at.T.multiply(1.0 / at.sum(axis=0)[:, None]).tocsr()


def shares(mesh: TriangleMesh) -> Array:
    """r of the module's text, (T,), by sampling."""
    at, around = averages(mesh)
    left, all_of_it = (off_normals(mesh, found) for found in (curved_offsets(mesh), flat(mesh)))
    for _ in range(fairing.RINGS):
        left, all_of_it = (at @ (around @ values) / 3.0 for values in (left, all_of_it))
    return np.asarray(np.sqrt(left / np.maximum(all_of_it, 1e-12)))


def balance(mesh: TriangleMesh) -> Array:
    """rho of the module's text, (T,)."""
    share = shares(mesh)
    return fairing.RESOLVED / (1.0 + (share / fairing.COARSE) ** fairing.POWER) + fairing.NOISY * share


def corrected(mesh: TriangleMesh) -> Array:
    """n of the module's text, (N, 3), from the surface's own normals by differences beside each corner."""
    _, around = averages(mesh)
    own = np.stack([normals_on(mesh, curved_offsets(mesh), corner[None])[:, 0] for corner in np.eye(3)], axis=1)
    corners = mesh.vertices[mesh.triangles]
    ahead, back = (np.roll(corners, way, axis=1) - corners for way in (-1, 1))
    long = np.linalg.norm(ahead, axis=2) * np.linalg.norm(back, axis=2)
    sine = np.linalg.norm(np.cross(ahead, back), axis=2) / long
    summed = np.zeros((mesh.node_count, 3))
    np.add.at(summed, mesh.nodes, (sine / long)[:, :, None] * own)
    made = around @ (1.0 / (1.0 + (shares(mesh) / fairing.COARSE) ** fairing.POWER))
    first = node_normals(mesh)
    return unit(first + made[:, None] * (unit(summed) - first))


def energy(mesh: TriangleMesh, offsets: tuple[Array, Array], rho: Array) -> float:
    """The energy of the module's text for a mesh that is wound outwards, by sampling, with true normals."""
    corners = mesh.vertices[mesh.triangles]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    moved = ((on(mesh, offsets) - on(mesh, flat(mesh))) ** 2).sum(axis=2).mean(axis=1)
    return float((moved + area * rho * off_normals(mesh, offsets, corrected(mesh))).sum())


def off_curved(mesh: TriangleMesh) -> tuple[float, float]:
    """How far moves and bulges are off those of the curved surface, in shares of the largest of these."""
    pairs = zip(fair_offsets(mesh), curved_offsets(mesh), strict=True)
    moves, bulges = (float(np.abs(fair - curved).max() / np.abs(curved).max()) for fair, curved in pairs)
    return moves, bulges


@pytest.mark.parametrize("roughness", [0.0, 0.003])
def test_no_surface_near_it_has_less_energy(roughness: float) -> None:
    mesh = rough_sphere(roughness)
    moves, bulges = fair_offsets(mesh)
    rho, around = balance(mesh), node_normals(mesh)
    least = energy(mesh, (moves, bulges), rho)
    random = np.random.default_rng(5)
    assert least < 0.9 * energy(mesh, flat(mesh), rho)
    assert least < 0.99 * energy(mesh, curved_offsets(mesh), rho)
    for _ in range(3):
        size = 0.2 * np.abs(moves).max()
        other = moves + size * random.normal(size=len(moves))[:, None] * around
        assert least < energy(mesh, (other, bulges), rho)
    # linear to first order only: a little more or less of everything hardly gains
    for share in (0.9, 1.1):
        assert least < 1.002 * energy(mesh, (share * moves, share * bulges), rho)


def test_what_the_mesh_resolves_is_nearly_curved() -> None:
    """And the finer the mesh, the nearer: over a sphere r falls with the length of edges."""
    mesh = build_mesh(*sphere(16))
    assert max(off_curved(mesh)) < 0.2
    assert balance(mesh).min() > 0.6 * fairing.RESOLVED


def rounded_edge(strips: int) -> tuple[TriangleMesh, NDArray[np.bool_]]:
    """A quarter of a cylinder between planes of wide quads, and its triangles away from the ends of the sheet."""
    angles = np.linspace(0.0, 0.5 * np.pi, strips + 1)
    arc = np.column_stack([np.sin(angles), np.cos(angles) - 1.0])
    before, after = np.arange(-8, 0)[:, None] * [0.4, 0.0], arc[-1] + np.arange(1, 9)[:, None] * [0.0, -0.4]
    outline = np.concatenate([before, arc, after])
    rows = np.arange(0.0, 8.1, 0.4)
    vertices = np.array([[x, y, z] for x, z in outline for y in rows])
    number = np.arange(len(vertices)).reshape(len(outline), len(rows))
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    mesh = build_mesh(vertices, quads)
    middle = (np.abs(mesh.vertices[:, 1] - 4.0) < 1.0)[mesh.triangles].all(axis=1)
    across = mesh.vertices[mesh.triangles].mean(axis=1)[:, [0, 2]] * [1.0, -1.0]
    return mesh, middle & ((across > 1e-6) & (across < 1.0 - 1e-6)).all(axis=1)


def followed(strips: int) -> float:
    """How far the fair surface of a rounded edge is off the triangles, in shares of how far the curved one is."""
    mesh, bent = rounded_edge(strips)
    fair, curved = (
        (on(mesh, found) - on(mesh, flat(mesh)))[bent] for found in (fair_offsets(mesh), curved_offsets(mesh))
    )
    return float(np.sqrt((fair**2).sum() / (curved**2).sum()))


def out_of_round(strips: int) -> float:
    """How much the fair surface of a rounded edge varies about its radius, in shares of how much the triangles do."""
    mesh, bent = rounded_edge(strips)
    fair, triangles = (on(mesh, found)[bent] - [0.0, 0.0, -1.0] for found in (fair_offsets(mesh), flat(mesh)))
    return float(np.hypot(fair[..., 0], fair[..., 2]).std() / np.hypot(triangles[..., 0], triangles[..., 2]).std())


def test_where_curvature_begins_on_coarse_edges_the_triangles_count() -> None:
    """Of a rounded edge of four strips between planes n says as little as the triangles do, of finer ones more."""
    mesh, bent = rounded_edge(4)
    assert balance(mesh)[bent].max() < 0.25 * fairing.RESOLVED
    found, rho = fair_offsets(mesh), balance(mesh)
    for share in np.linspace(0.0, 1.0, 6):
        curved = tuple(share * part for part in curved_offsets(mesh))
        assert energy(mesh, found, rho) < energy(mesh, (curved[0], curved[1]), rho)
    assert followed(4) < followed(8) < 1.0
    assert out_of_round(4) < 0.5
    assert out_of_round(8) < 0.75 * out_of_round(4)


def test_roughness_ripples_less_than_the_curved_surface() -> None:
    mesh = rough_sphere(0.004)
    fair, curved = (np.sqrt(off_normals(mesh, found).mean()) for found in (fair_offsets(mesh), curved_offsets(mesh)))
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

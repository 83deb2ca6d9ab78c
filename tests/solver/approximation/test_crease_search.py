"""Which edges are cut: those of models whose creases are known, and those that are marked."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from sparse_surface.benchmarks.generated_models import cube, cylinder, flower, sphere, tetrahedron
from sparse_surface.solver import InputError, Settings, SettingsError, approximate
from sparse_surface.solver.mesh.potential_creases import dihedrals, potential_creases
from sparse_surface.solver.mesh.triangle_mesh import TriangleMesh, build_mesh, cut_along
from sparse_surface.solver.settings import PRESETS

Indices = NDArray[np.int64]
QUICK = {"workers": 1, "sweeps": 0, "iterations": 4}


def bent_by(mesh: TriangleMesh, degrees: float) -> set[tuple[int, int]]:
    """Edges whose triangles' normals are farther apart than this."""
    corners = mesh.vertices[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    one, other = normals[mesh.edge_triangles.T]
    bent = (one * other).sum(axis=1) < np.cos(np.radians(degrees))
    return {(int(min(pair)), int(max(pair))) for pair in mesh.edges[bent]}


def found(vertices: object, faces: object, **settings: object) -> set[tuple[int, int]]:
    result = approximate(vertices, faces, Settings(**{**QUICK, **settings}))
    return {(int(a), int(b)) for a, b in result.representation.creases}


def test_the_edges_of_a_cube_are_cut_and_nothing_else() -> None:
    assert found(*cube(12)) == bent_by(build_mesh(*cube(12)), 30.0)


def test_those_of_a_cylinder_and_a_flower() -> None:
    for model, degrees in ((cylinder(), 45.0), (flower(), 30.0)):
        creases, sharp = found(*model), bent_by(build_mesh(*model), degrees)
        assert sharp <= creases
        assert len(creases - sharp) <= 0.05 * len(sharp)


def test_a_sphere_has_none() -> None:
    assert not potential_creases(build_mesh(*sphere(8))).edges.any()
    result = approximate(*sphere(8), Settings(**QUICK))
    assert result.report["creases"] == {"edges": 0, "vertices": 0, "share_at_edge": 1.0}


def test_noise_on_a_sphere_has_none() -> None:
    vertices, faces = sphere(16)
    rough = vertices + np.random.default_rng(0).normal(scale=0.05, size=vertices.shape)
    assert potential_creases(build_mesh(rough, faces)).edges.any()
    assert not found(rough, faces, iterations=2)


def folded_sheet(cells: int, slope: float) -> tuple[NDArray[np.float64], Indices]:
    """A gently waved square of quads, folded along its middle row of edges."""
    y, x = np.mgrid[0 : cells + 1, 0 : cells + 1] / cells
    height = 0.05 * np.sin(3.0 * x) * np.cos(2.0 * y) - slope * np.abs(x - 0.5)
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1)
    return np.stack([x, y, height], axis=-1).reshape(-1, 3), quads.reshape(-1, 4)


@pytest.mark.parametrize(("cells", "edges"), [(24, 24), (30, 0)])
def test_creases_are_the_same_however_closely_patches_are_fitted(cells: int, edges: int) -> None:
    """A fold of 44 degrees lies between the two: with its own settings *precise* would cut both."""
    sheet = folded_sheet(cells, 0.4)
    creases = found(*sheet)
    assert len(creases) == edges
    assert found(*sheet, **PRESETS["precise"]) == creases


def test_a_crease_that_fades_is_cut_as_far_as_it_bends_and_ends_smoothly() -> None:
    cells = 40
    y, x = np.mgrid[0 : cells + 1, 0 : cells + 1] / cells
    height = 0.1 * np.sin(3.0 * x) * np.cos(2.0 * y) - np.clip(1.2 - 1.6 * y, 0.0, None) * np.abs(x - 0.5)
    vertices = np.stack([x, y, height], axis=-1).reshape(-1, 3)
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, -1)
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    inside = np.random.default_rng(4).dirichlet([1.0, 1.0, 1.0], 8 * len(faces))
    face = np.repeat(np.arange(len(faces)), 8)
    truth = np.einsum("nk,nkd->nd", inside, vertices[faces[face]])
    off = {}
    for creases in ("auto", "off"):
        surface = approximate(vertices, faces, Settings(**QUICK, creases=creases)).representation
        off[creases] = np.linalg.norm(surface.evaluate(face, inside) - truth, axis=1)
        if creases == "auto":
            ends = vertices[surface.creases]
    assert (ends[..., 0] == 0.5).all()
    assert ends[..., 1].min() == 0.0
    assert 0.6 < ends[..., 1].max() < 0.75
    beside = np.abs(truth[:, 0] - 0.5) < 0.05
    for low, high, better in ((0.0, 0.5, 5.0), (0.5, 0.9, 1.0)):
        here = beside & (truth[:, 1] > low) & (truth[:, 1] < high)
        assert better * off["auto"][here].max() < off["off"][here].max()


@pytest.mark.parametrize("settings", [{"method": "paper"}, {"method": "traditional"}, {"blending": "uniform"}])
def test_methods_without_creases(settings: dict[str, str]) -> None:
    assert not found(*cube(8), iterations=1, **settings)
    assert "creases" not in approximate(*cube(6), Settings(workers=1, iterations=1, **settings)).report
    with pytest.raises(SettingsError, match="Marked creases"):
        approximate(*cube(6), Settings(creases="marked", **settings))


def sheet(cells: int = 10) -> tuple[NDArray[np.float64], Indices]:
    y, x = np.mgrid[0 : cells + 1, 0 : cells + 1] / cells
    vertices = np.column_stack([x.ravel(), y.ravel(), 0.1 * np.sin(3.0 * x.ravel())])
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, -1)
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    return vertices, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])


def test_only_marked_edges_are_cut() -> None:
    vertices, faces = sheet()
    column = 5 + 11 * np.arange(11)
    line = np.stack([column[:-1], column[1:]], axis=1)
    for marked in (line, line[:, ::-1], line[3:7]):
        result = approximate(vertices, faces, Settings(**QUICK, creases="marked"), sharp_edges=marked)
        np.testing.assert_array_equal(result.creases, np.sort(marked, axis=1))
    assert approximate(vertices, faces, Settings(**QUICK, creases="marked")).creases is None


def test_an_edge_by_itself_opens_nothing() -> None:
    vertices, faces = sheet()
    border_and_single = [[0, 1], [60, 61], [3, 90]]
    result = approximate(vertices, faces, Settings(**QUICK, creases="marked"), sharp_edges=border_and_single)
    assert result.creases is None
    assert result.report["creases"]["edges"] == 0


@pytest.mark.parametrize("edges", [[[0, 1, 2]], [[0, 500]], [[-1, 2]], [[0.5, 2.0]], [1, 2]])
def test_what_is_no_edge_is_refused(edges: object) -> None:
    with pytest.raises(InputError, match="Sharp edges"):
        approximate(*sheet(), Settings(**QUICK, creases="marked"), sharp_edges=edges)


def test_vertices_without_weight_and_small_meshes_survive() -> None:
    vertices, faces = cube(8)
    weights = (vertices[:, 0] < 0.0).astype(float)
    result = approximate(vertices, faces, Settings(**QUICK), weights=weights)
    held = weights == 0.0
    np.testing.assert_array_equal(result.vertices[held], vertices[held])
    for points, corners in (tetrahedron(), cube(1), cube(2)):
        everything = build_mesh(points, corners).edges
        result = approximate(points, corners, Settings(**QUICK, creases="marked"), sharp_edges=everything)
        assert np.isfinite(result.vertices).all()
        assert result.report["relative"]["surface_max"] < 1e-6


def test_counts_and_borders_are_those_of_the_input() -> None:
    result = approximate(*cube(8), Settings(**QUICK, pin_boundary=True))
    assert len(result.representation.creases) == 96
    assert result.report["input"]["components"] == 1
    assert result.report["input"]["coincident_vertices"] == 0
    assert result.report["passed_through_vertices"] == 0


def test_cutting_a_cube_gives_its_six_faces() -> None:
    mesh = build_mesh(*cube(4))
    parts = cut_along(mesh, dihedrals(mesh) > 45.0)
    assert parts.component_count == 6
    assert parts.node_count == 6 * 25
    assert len(parts.creases) == 48
    assert not parts.passed_through.any()
    np.testing.assert_array_equal(parts.node_vertex[parts.nodes], parts.triangles)
    np.testing.assert_array_equal(np.bincount(parts.node_vertex), 1 + (np.abs(mesh.vertices) == 0.5).sum(axis=1) - 1)


def test_the_result_does_not_depend_on_workers_or_place() -> None:
    vertices, faces = cube(8)
    one = approximate(vertices, faces, Settings(**QUICK))
    two = approximate(vertices, faces, Settings(**{**QUICK, "workers": 2}))
    assert one.representation.stored == two.representation.stored
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    moved = approximate(7.0 * vertices @ turn.T + 3.0, faces, Settings(**QUICK))
    np.testing.assert_array_equal(moved.representation.creases, one.representation.creases)
    assert moved.report["relative"]["surface_max"] < 1e-9

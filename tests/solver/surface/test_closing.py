"""Surfaces that are cut along creases: closed to rounding, differentiated exactly, the same in files."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from sparse_surface.benchmarks.generated_models import cylinder, flower, moebius, thin_torus
from sparse_surface.solver import Approximation, Representation, Settings, approximate, resample
from sparse_surface.solver.mesh.triangle_mesh import build_mesh, cut_along
from sparse_surface.solver.surface.bounds import error_bounds
from sparse_surface.solver.surface.closing import SLIDE, Closing, Fans
from sparse_surface.solver.surface.inspection import single_patch

Array = NDArray[np.float64]

COARSE = {"ring": 5, "degree": 6, "sparsity": 5, "iterations": 3, "sweeps": 0, "workers": 1}
"""So few functions that the sides of a crease are far from meeting."""

SURFACES = {
    "default": Settings(workers=1),
    "few functions": Settings(**COARSE),
    "constants only": Settings(**{**COARSE, "degree": 0, "sparsity": 1}),
    "a domain for each coordinate": Settings(**COARSE, domains="separate"),
}


@cache
def cut(name: str) -> Approximation:
    vertices, faces = cylinder()
    edges = build_mesh(vertices, faces).edges
    height, radius = np.abs(vertices[:, 2]), np.linalg.norm(vertices[:, :2], axis=1)
    on_rim = (height > height.max() - 1e-9) & (radius > radius.max() - 1e-9)
    settings = replace(SURFACES[name], creases="marked")
    return approximate(vertices, faces, settings, sharp_edges=edges[on_rim[edges].all(axis=1)])


def sides_of_edges(surface: Representation) -> list[tuple[tuple[int, int], list[tuple[int, int]]]]:
    """Vertices of each edge, with its triangles and the corner in each from which it starts."""
    found: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for number, triangle in enumerate(surface.triangles):
        for corner in range(3):
            start, end = int(triangle[corner]), int(triangle[(corner + 1) % 3])
            found.setdefault((min(start, end), max(start, end)), []).append((number, corner))
    return [(ends, sides) for ends, sides in found.items() if len(sides) == 2]


def at_edges(surface: Representation, share: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Points of all edges as their first and as their second triangle have them, and which edges are creases."""
    creases = set(map(tuple, surface.creases))
    sides = sides_of_edges(surface)
    face = np.array([[number for number, _ in both] for _, both in sides])
    inside = np.zeros((len(sides), 2, 3))
    for row, ((low, _), both) in enumerate(sides):
        for k, (number, corner) in enumerate(both):
            along = share if surface.triangles[number, corner] == low else 1.0 - share
            inside[row, k, corner], inside[row, k, (corner + 1) % 3] = 1.0 - along, along
    points = surface.evaluate(face.ravel(), inside.reshape(-1, 3)).reshape(-1, 2, 3)
    return points[:, 0], points[:, 1], np.array([ends in creases for ends, _ in sides])


@pytest.mark.parametrize("name", SURFACES)
def test_both_sides_of_every_edge_meet(name: str) -> None:
    surface = cut(name).representation
    assert len(surface.creases) == 120
    assert np.abs(surface.closing.corners).max() > (1e-6 if name == "default" else 1e-4)
    for share in (0.0, 0.13, 0.5, 0.71, 1.0):
        one, other, _ = at_edges(surface, share)
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-13 * np.ptp(surface.vertices, axis=0).max())


def test_without_the_correction_they_do_not() -> None:
    surface = cut("few functions").representation
    open_ = replace(surface)
    nothing = np.zeros((0, 3))
    nowhere = np.full(len(surface.triangles), -1)
    vars(open_)["closing"] = Closing(
        nowhere, np.zeros((0, 3, 3)), nothing.astype(int), np.zeros((0, 8, 3)), nowhere[:0], nothing
    )
    one, other, crease = at_edges(open_, 0.5)
    gap = np.linalg.norm(one - other, axis=1)
    assert np.median(gap[crease]) > 1e-4
    assert gap[~crease].max() < 1e-12


@pytest.mark.parametrize("name", ["default", "few functions", "constants only"])
def test_tangents_are_the_derivatives(name: str) -> None:
    surface = cut(name).representation
    rows = np.flatnonzero(surface.closing.row >= 0)
    random = np.random.default_rng(5)
    face = random.choice(rows, 300)
    inside = 0.02 + 0.94 * random.dirichlet((1.0, 1.0, 1.0), 300)
    _, tangents = surface.evaluate_with_tangents(face, inside)
    step = 1e-5
    for k in (1, 2):
        move = np.zeros(3)
        move[[0, k]] = -step, step
        ahead, behind = surface.evaluate(face, inside + move), surface.evaluate(face, inside - move)
        slope = (ahead - behind) / (2.0 * step)
        np.testing.assert_allclose(tangents[:, k - 1], slope, atol=2e-6 * (1.0 + np.abs(tangents).max()))


def test_vertices_are_where_every_triangle_has_them() -> None:
    surface = cut("few functions").representation
    at_corners = surface.evaluate(
        np.repeat(np.arange(len(surface.triangles)), 3), np.tile(np.eye(3), (len(surface.triangles), 1))
    )
    np.testing.assert_allclose(at_corners, surface.at_vertices()[surface.triangles.ravel()], atol=1e-13)


def test_the_surface_turns_at_the_edge() -> None:
    surface, report = cut("default").representation, cut("default").report["creases"]
    assert (report["edges"], report["vertices"]) == (120, 120)
    assert report["share_at_edge"] > 0.99
    # the rims of a cylinder are right angles
    creases = set(map(tuple, surface.creases))
    angles = []
    for ends, ((one, first), (other, second)) in sides_of_edges(surface):
        if ends in creases:
            inside = np.zeros((2, 3))
            inside[0, [first, (first + 1) % 3]] = inside[1, [second, (second + 1) % 3]] = 0.5
            normals = surface.normals(np.array([one, other]), inside)
            angles.append(np.degrees(np.arccos(normals[0] @ normals[1])))
    away = np.abs(np.array(angles) - 90.0)
    assert len(away) == 120
    assert away.mean() < 4.0
    assert away.max() < 12.0


def test_sides_meet_where_their_tangent_planes_do() -> None:
    surface = cut("few functions").representation
    open_ = surface._evaluate(
        np.repeat(np.arange(len(surface.triangles)), 3),
        np.tile(np.eye(3), (len(surface.triangles), 1)),
        tangents=True,
        closed=False,
    )
    normals = np.cross(open_[:, 1], open_[:, 2])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    meeting = surface.at_vertices()
    for vertex in surface.creases[:40, 0]:
        at = np.flatnonzero(surface.triangles.ravel() == vertex)
        node = surface.fans.corners.ravel()[at]
        rows, wanted = [], []
        for side in np.unique(node):
            own = at[node == side]
            point = open_[own[0], 0]
            rows += [normals[own] / np.sqrt(len(own)), np.sqrt(SLIDE) * np.eye(3)]
            wanted += [normals[own] @ point / np.sqrt(len(own)), np.sqrt(SLIDE) * point]
        expected = np.linalg.lstsq(np.concatenate(rows), np.concatenate(wanted), rcond=None)[0]
        np.testing.assert_allclose(meeting[vertex], expected, atol=1e-12)


def test_normals_beside_a_crease_are_those_of_the_shape() -> None:
    vertices, _ = cylinder()
    surface = cut("default").representation
    corners = surface.vertices[surface.triangles]
    on_rim = np.isin(surface.triangles, surface.creases)
    beside = np.flatnonzero(on_rim.sum(axis=1) == 2)
    # a tenth of the way from the rim to the opposite corner, and closer
    inside = np.concatenate([np.where(on_rim[beside], (1.0 - away) / 2.0, away) for away in (0.01, 0.05, 0.1)])
    face = np.tile(beside, 3)
    points = np.einsum("nk,nkd->nd", inside, corners[face])
    wall = np.ptp(corners[face][:, :, 2], axis=1) > 1e-6 * np.ptp(vertices[:, 2])
    radial = points * [1.0, 1.0, 0.0] / np.linalg.norm(points[:, :2], axis=1, keepdims=True)
    truth = np.where(wall[:, None], radial, np.sign(points) * [0.0, 0.0, 1.0])
    angles = np.degrees(np.arccos(np.clip((surface.normals(face, inside) * truth).sum(axis=1), -1.0, 1.0)))
    assert wall.sum() > 300
    assert (~wall).sum() > 300
    assert angles.mean() < 0.5
    assert np.quantile(angles, 0.95) < 2.0


def test_bounds_hold_for_the_closed_surface() -> None:
    surface = cut("few functions").representation
    inside = np.random.default_rng(3).dirichlet((0.5, 0.5, 0.5), 200)
    face = np.repeat(np.arange(len(surface.triangles)), 200)
    inside = np.tile(inside, (len(surface.triangles), 1))
    flat = np.einsum("nk,nkd->nd", inside, surface.vertices[surface.triangles[face]])
    largest = np.linalg.norm(surface.evaluate(face, inside) - flat, axis=1).max()
    lower, upper = error_bounds(surface)
    assert lower <= 1.05 * largest
    assert largest <= upper <= 1.1 * largest


def test_files_carry_creases() -> None:
    surface = cut("few functions").representation
    loaded = Representation.from_bytes(surface.stored)
    np.testing.assert_array_equal(loaded.creases, surface.creases)
    one, other, _ = at_edges(loaded, 0.37)
    np.testing.assert_allclose(one, other, atol=1e-13)
    np.testing.assert_allclose(one, at_edges(surface, 0.37)[0], atol=1e-6)


def test_resampled_creases_are_known() -> None:
    surface = cut("few functions").representation
    finer = resample(surface, 3)
    assert len(finer.creases) == 3 * len(surface.creases)
    edges = {tuple(sorted(pair)) for face in finer.polygons() for pair in zip(face, np.roll(face, -1), strict=True)}
    assert {tuple(sorted(pair)) for pair in finer.creases} <= edges
    radius = np.linalg.norm(finer.vertices[finer.creases.ravel(), :2], axis=1)
    assert radius.min() > 0.9 * radius.max()


def test_a_patch_by_itself_is_not_corrected() -> None:
    surface = cut("few functions").representation
    alone = single_patch(surface, 0)
    own = slice(*surface.vertex_offsets[:2])
    np.testing.assert_allclose(alone.at_vertices(), surface.at_patch_vertices[own], atol=1e-12)


def test_reports_say_what_was_cut() -> None:
    off = approximate(*flower(), Settings(workers=1, iterations=0, sweeps=0, creases="off"))
    assert "creases" not in off.report
    assert off.creases is None
    assert not len(off.representation.creases)


@pytest.mark.parametrize("share", [0.01, 0.1, 0.6, 1.0])
def test_the_fans_of_a_cut_mesh_are_its_nodes(share: float) -> None:
    random = np.random.default_rng(int(100 * share))
    for vertices, faces in (cylinder(), moebius()[:2], thin_torus()[:2]):
        triangles = build_mesh(vertices, faces).triangles
        collapsed = triangles[::40, [0, 0, 1]]
        for own in (triangles, np.concatenate([triangles[random.random(len(triangles)) > 0.05], collapsed])):
            mesh = build_mesh(vertices, own)
            mesh = cut_along(mesh, (random.random(len(mesh.edges)) < share) & (mesh.edge_triangles[:, 1] >= 0))
            found, expected = Fans.of_mesh(mesh), Fans.of(mesh.triangles, mesh.creases, len(vertices))
            assert (found is None) == (not len(mesh.creases))
            if found is not None:
                for name in ("corners", "vertex", "sides"):
                    assert np.array_equal(getattr(found, name), getattr(expected, name))
        fin = np.concatenate([triangles, triangles[:3, [0, 1, 1]] + [0, 0, 7]])  # three triangles at an edge
        mesh = build_mesh(vertices, fin)
        assert Fans.of_mesh(cut_along(mesh, mesh.edge_triangles[:, 1] >= 0)) is None

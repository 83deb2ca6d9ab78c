"""The evaluated surface against a direct sum over the patches, finite differences and its own continuity."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from numpy.polynomial import legendre
from numpy.typing import NDArray
from sparse_surface.benchmarks.generated_models import cube, moebius
from sparse_surface.solver import InputError, Representation, Settings, approximate
from sparse_surface.solver.mesh.sampling import MEASURED_SAMPLES
from sparse_surface.solver.surface.metrics import seam, surface_error

Array = NDArray[np.float64]

QUICK = {"ring": 4, "degree": 8, "sparsity": 8, "iterations": 3, "sweeps": 0}
KINDS: dict[str, dict[str, object]] = {
    "common": {},
    "separate": {"domains": "separate"},
    "monomials": {"basis": "monomial"},
    "uniform": {"blending": "uniform"},
}


def bow_tie() -> tuple[Array, list[list[int]]]:
    """Two bent grids of quads that share one vertex, one quad cut off to a pentagon and a triangle."""
    u, v = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9), indexing="ij")
    sheet = np.stack([u, v, 0.3 * np.abs(u + 0.3 * v - 0.6)], axis=-1).reshape(-1, 3)
    number = np.arange(81).reshape(9, 9)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    other = quads + 80  # the last vertex of the first sheet is the first one of the second
    vertices = np.concatenate([sheet, sheet[1:] + sheet[-1]])
    faces = [list(map(int, face)) for face in np.concatenate([quads, other])]
    extra = len(vertices)
    a, b, c, d = faces[10]
    faces[10:11] = [[a, b, c, extra, d], [c, d, extra]]
    vertices = np.concatenate([vertices, [(vertices[c] + vertices[d]) / 2 + [0.0, -0.02, 0.0]]])
    return vertices, faces


MESHES = {"cube": lambda: cube(7), "bow tie": bow_tie, "moebius": lambda: moebius(36, 5)}


SOLVERS = ("native", "numpy")


@cache
def representation(mesh: str, kind: str, solver: str = "native") -> Representation:
    vertices, faces = MESHES[mesh]()
    found = approximate(vertices, faces, Settings(**{**QUICK, **KINDS[kind]})).representation
    return replace(found, solver=solver)


@pytest.fixture(params=list(product(MESHES, KINDS, SOLVERS)), ids="-".join)
def surface(request: pytest.FixtureRequest) -> Representation:
    return representation(*request.param)


def some_points(surface: Representation, count: int = 60) -> tuple[NDArray[np.int64], Array]:
    rng = np.random.default_rng(5)
    face = rng.integers(0, len(surface.triangles), count)
    inside = rng.dirichlet([1.0, 1.0, 1.0], count)
    return face, inside


def polynomial(surface: Representation, i: int, j: int, u: float, v: float) -> float:
    if surface.basis == "monomial":
        return float(u**i * v**j)
    one = legendre.legval(u / 1.05, [0.0] * i + [1.0])
    return float(one * legendre.legval(v / 1.05, [0.0] * j + [1.0]))


def directly(surface: Representation, triangle: int, inside: Array) -> Array:
    """The surface at one point, patch by patch, function by function."""
    flat = inside @ surface.vertices[surface.triangles[triangle]]
    holders = np.flatnonzero(surface.mesh_triangles == triangle)
    total, point = 0.0, np.zeros(3)
    for entry in holders:
        patch = int(np.searchsorted(surface.triangle_offsets, entry, side="right")) - 1
        ends = surface.vertex_offsets[patch] + surface.patch_triangles[entry]
        # A patch may have turned the triangle: its corners are told apart by their vertices.
        at = np.array([ends[list(surface.patch_vertices[ends]).index(v)] for v in surface.triangles[triangle]])
        weights = surface.weights[at]
        if surface.blending == "uniform":
            weights = (weights > 0.0) / len(holders)
        phi = float(inside @ weights)
        total += phi
        for d in range(3):
            c = d if len(surface.domains) == 3 else 0
            u, v = inside @ surface.domains[c, at]
            functions = surface.dictionary.degrees[surface.support[patch, d]]
            value = sum(
                coefficient * polynomial(surface, i, j, u, v)
                for (i, j), coefficient, number in zip(
                    functions, surface.coefficients[patch, d], surface.support[patch, d], strict=True
                )
                if number >= 0
            )
            point[d] += phi * (surface.origins[patch, d] + value / surface.scales[patch, c])
    return point + (1.0 - total) * flat


def test_it_is_the_sum_over_the_patches(surface: Representation) -> None:
    face, inside = some_points(surface)
    expected = [directly(surface, int(t), b) for t, b in zip(face, inside, strict=True)]
    np.testing.assert_allclose(surface.evaluate(face, inside), expected, rtol=0.0, atol=1e-11)


def test_holders_are_the_patch_triangles_with_weight_over_each_triangle() -> None:
    surface = representation("bow tie", "common")
    starts, held, patch = surface.holders
    for triangle in range(len(surface.triangles)):
        over = np.flatnonzero(surface.mesh_triangles == triangle)
        expected = [own for own in over if surface.weights[surface.corners[own]].max() > 0.0]
        assert held[starts[triangle] : starts[triangle + 1]].tolist() == expected
        assert patch[starts[triangle] : starts[triangle + 1]].tolist() == surface.patch_of_triangle[expected].tolist()


def test_order_and_number_of_the_points_do_not_matter(surface: Representation) -> None:
    """More points in one patch than are evaluated together, in any order, one by one, twice the same."""
    rng = np.random.default_rng(1)
    face, inside = some_points(surface, 20_000)
    together = surface.evaluate(face, inside)
    shuffled = rng.permutation(len(face))
    np.testing.assert_array_equal(surface.evaluate(face[shuffled], inside[shuffled]), together[shuffled])
    for one in range(3):
        alone = surface.evaluate(face[one : one + 1], inside[one : one + 1])
        np.testing.assert_allclose(alone[0], together[one], rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(surface.evaluate(face.astype(np.int32), inside), together)


def test_tangents_are_those_of_finite_differences(surface: Representation) -> None:
    face, inside = some_points(surface)
    inside = 0.9 * inside + 0.1 / 3.0
    points, tangents = surface.evaluate_with_tangents(face, inside)
    np.testing.assert_allclose(points, surface.evaluate(face, inside), rtol=0.0, atol=1e-14)
    step = 1e-5
    for k in (1, 2):
        along = np.zeros(3)
        along[[0, k]] = -step, step
        there, back = surface.evaluate(face, inside + along), surface.evaluate(face, inside - along)
        np.testing.assert_allclose(tangents[:, k - 1], (there - back) / (2 * step), rtol=1e-5, atol=1e-8)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("kind", list(KINDS))
def test_tangents_where_the_input_shows_through(kind: str, solver: str) -> None:
    """Around the vertex that the bow tie's sheets share, which no patch moves, the input has a part of the weight."""
    surface = representation("bow tie", kind, solver)
    face = np.flatnonzero((surface.triangles == 80).any(axis=1))
    assert len(face) == 4
    inside = np.tile([0.5, 0.2, 0.3], (len(face), 1))
    _, tangents = surface.evaluate_with_tangents(face, inside)
    for k in (1, 2):
        along = np.zeros(3)
        along[[0, k]] = -1e-5, 1e-5
        there, back = (
            [directly(surface, t, b) for t, b in zip(face, inside + s * along, strict=True)] for s in (1, -1)
        )
        np.testing.assert_allclose(tangents[:, k - 1], np.subtract(there, back) / 2e-5, rtol=1e-5, atol=1e-8)


def test_normals_are_unit_and_stand_on_the_tangents(surface: Representation) -> None:
    face, inside = some_points(surface)
    _, tangents = surface.evaluate_with_tangents(face, inside)
    normals = surface.normals(face, inside)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.einsum("nd,nkd->nk", normals, tangents), 0.0, atol=1e-12)
    if surface.triangles is representation("cube", "common").triangles:
        outwards = inside[:, None] @ surface.vertices[surface.triangles[face]]
        assert ((normals * outwards[:, 0]).sum(axis=1) > 0.0).mean() > 0.95


@pytest.mark.parametrize("mesh", list(MESHES))
@pytest.mark.parametrize("kind", ["common", "separate", "monomials"])
def test_partition_of_unity_is_continuous_and_meets_the_vertices(mesh: str, kind: str) -> None:
    surface = representation(mesh, kind)
    corners = np.eye(3)
    face = np.repeat(np.arange(len(surface.triangles)), 3)
    at_corners = surface.evaluate(face, np.tile(corners, (len(surface.triangles), 1)))
    np.testing.assert_allclose(at_corners, surface.at_vertices()[surface.triangles.ravel()], rtol=0.0, atol=1e-12)
    for first, second, ends, other_ends in shared_edges(surface):
        for share in (0.07, 0.5, 0.8):
            sides = np.zeros((2, 3))
            sides[0, ends] = 1.0 - share, share
            sides[1, other_ends] = 1.0 - share, share
            one, other = surface.evaluate(np.array([first, second]), sides)
            np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-12)


def shared_edges(surface: Representation) -> list[tuple[int, int, list[int], list[int]]]:
    """Some edges of two triangles: the triangles, and where the edge's ends stand in each of them."""
    seen: dict[frozenset[int], tuple[int, list[int]]] = {}
    found = []
    for number, triangle in enumerate(surface.triangles.tolist()):
        for a, b in ((0, 1), (1, 2), (2, 0)):
            edge = frozenset((triangle[a], triangle[b]))
            if edge in seen:
                first, ends = seen[edge]
                order = [triangle.index(surface.triangles[first][end]) for end in ends]
                found.append((first, number, ends, order))
            seen[edge] = (number, [a, b])
    return found[:: max(1, len(found) // 60)]


def test_measures_agree_with_evaluating_by_hand() -> None:
    surface = representation("bow tie", "common")
    assert seam(surface) < 1e-12
    assert seam(representation("bow tie", "uniform")) > 1e-6
    errors = surface_error(surface)
    flat = MEASURED_SAMPLES @ surface.vertices[surface.triangles[7]]
    expected = np.linalg.norm([directly(surface, 7, b) for b in MEASURED_SAMPLES] - flat, axis=1)
    np.testing.assert_allclose(errors[7], expected, atol=1e-12)


def test_a_plane_is_itself() -> None:
    u, v = np.meshgrid(np.arange(12.0), np.arange(9.0), indexing="ij")
    vertices = np.stack([u, v, 0.5 * u - 0.2 * v + 3.0], axis=-1).reshape(-1, 3)
    number = np.arange(108).reshape(12, 9)
    faces = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    surface = approximate(vertices, faces, Settings(**QUICK)).representation
    face, inside = some_points(surface)
    points, tangents = surface.evaluate_with_tangents(face, inside)
    ends = surface.vertices[surface.triangles[face]]
    np.testing.assert_allclose(points, (inside[:, None] @ ends)[:, 0], atol=1e-6)
    np.testing.assert_allclose(tangents, ends[:, 1:] - ends[:, :1], atol=1e-4)


def test_where_no_patch_has_weight_the_input_shows_through() -> None:
    """The shared vertex of a bow tie belongs to no patch: the surface passes through it."""
    surface = representation("bow tie", "uniform")
    shared = 80
    triangle, corner = np.argwhere(surface.triangles == shared)[0]
    assert surface.input_weights[triangle, corner] == 1.0
    at = np.eye(3)[[corner]]
    np.testing.assert_array_equal(surface.evaluate(np.array([triangle]), at)[0], surface.vertices[shared])
    np.testing.assert_array_equal(surface.at_vertices()[shared], surface.vertices[shared])


@pytest.mark.parametrize(
    ("face", "inside", "said"),
    [
        ([0], [[0.5, 0.5]], "N x 3"),
        ([[0]], [[1.0, 0.0, 0.0]], "N face numbers"),
        ([-1], [[1.0, 0.0, 0.0]], "from 0 to"),
        ([10**6], [[1.0, 0.0, 0.0]], "from 0 to"),
        ([0.0], [[1.0, 0.0, 0.0]], "whole numbers"),
        ([0], [[0.5, 0.5, 0.5]], "sum 1"),
        ([0], [[1.5, -0.5, 0.0]], "from 0 to 1"),
        ([0], [[np.nan, 0.5, 0.5]], "from 0 to 1"),
        ([0], [[np.inf, -np.inf, 1.0]], "from 0 to 1"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_wrong_points_are_refused(face: list[int], inside: list[list[float]], said: str) -> None:
    with pytest.raises(InputError, match=said):
        representation("cube", "common").evaluate(np.array(face), np.array(inside))


def test_no_points_are_no_problem() -> None:
    surface = representation("cube", "common")
    nothing = np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    assert surface.evaluate(*nothing).shape == (0, 3)
    assert surface.evaluate_with_tangents(*nothing)[1].shape == (0, 2, 3)
    assert surface.normals(*nothing).shape == (0, 3)

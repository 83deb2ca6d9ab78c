"""The guaranteed bounds of the error: against dense random points, and against polynomials whose extremes are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import legendre
from numpy.typing import NDArray
from sparse_surface.benchmarks.generated_models import cube, cylinder, moebius, sphere
from sparse_surface.solver import Representation, Settings, approximate
from sparse_surface.solver.surface import bounds
from sparse_surface.solver.surface.bounds import ACCURACY, error_bounds, exceeding

Array = NDArray[np.float64]
POINTS_A_TRIANGLE = 150


def errors(surface: Representation, vertices: Array | None = None) -> Array:
    """Errors at random points of every triangle, some of them on edges and at corners, (T, n)."""
    count = len(surface.triangles)
    inside = np.random.default_rng(3).dirichlet((0.6, 0.6, 0.6), size=(count, POINTS_A_TRIANGLE))
    inside[:, :3] = np.eye(3)
    face = np.repeat(np.arange(count), POINTS_A_TRIANGLE)
    points = surface.evaluate(face, inside.reshape(-1, 3)).reshape(count, POINTS_A_TRIANGLE, 3)
    corners = (surface.vertices if vertices is None else vertices)[surface.triangles]
    return np.linalg.norm(points - np.einsum("tqk,tkd->tqd", inside, corners), axis=2)


SURFACES: dict[str, Callable[[], Any]] = {
    "creases": lambda: approximate(*cube(8), Settings(workers=1, ring=4, creases="off")),
    "cut along creases": lambda: approximate(*cylinder(), Settings(workers=1, ring=5, degree=6, sparsity=6)),
    "exact": lambda: approximate(*cube(8), Settings(workers=1, ring=4)),
    "a domain for each coordinate": lambda: approximate(*sphere(6), Settings(workers=1, domains="separate")),
    "the paper's method": lambda: approximate(*cube(8), Settings(workers=1, method="paper", iterations=3)),
    "open, borders pinned": lambda: approximate(*moebius(40, 6), Settings(workers=1, pin_boundary=True)),
    "degree 30": lambda: approximate(*cube(6), Settings(workers=1, degree=30, sparsity=60, iterations=2)),
    "nothing fitted": lambda: approximate(*cube(4), Settings(workers=1), weights=np.zeros(98)),
}


@pytest.mark.parametrize("solver", ["native", "numpy"])
@pytest.mark.parametrize("name", SURFACES)
def test_the_error_lies_between_its_bounds(name: str, solver: str) -> None:
    surface = replace(SURFACES[name]().representation, solver=solver)
    largest = float(errors(surface).max())
    lower, upper = error_bounds(surface)
    assert largest <= upper * (1.0 + 1e-9) + 1e-12
    assert upper <= max((1.0 + ACCURACY) * lower, 1e-11)
    # the lower bound is reached somewhere, and these points come near it
    assert lower <= 1.1 * largest + 1e-12


def test_a_search_that_is_cut_off_still_finds_much_of_the_largest_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """With functions of a high degree a model's remainder hides what the surface does, and splitting has its limits."""
    settings = Settings(workers=1, degree=30, sparsity=496, beta1=0.0, beta2=0.0, iterations=4, sweeps=0, creases="off")
    surface = approximate(*cube(6), replace(settings, ring=50)).representation
    monkeypatch.setattr(bounds, "MOST_SPLITS", 2)
    largest, (lower, upper) = float(errors(surface).max()), error_bounds(surface)
    assert 0.5 * largest <= lower <= 1.1 * largest
    assert largest <= upper


@pytest.mark.parametrize("name", ["cut along creases", "open, borders pinned", "a domain for each coordinate"])
def test_kernel_and_numpy_find_the_same_bounds_against_another_mesh(name: str) -> None:
    surface = SURFACES[name]().representation
    other = surface.vertices + np.random.default_rng(4).normal(scale=0.01, size=surface.vertices.shape)
    native, numpy = (error_bounds(replace(surface, solver=solver), other) for solver in ("native", "numpy"))
    assert native == pytest.approx(numpy, rel=1e-9)


@pytest.mark.parametrize("share", [0.05, 0.3, 0.9])
def test_no_point_exceeds_a_tolerance_where_that_is_excluded(share: float) -> None:
    surface = SURFACES["creases"]().representation
    largest = errors(surface).max(axis=1)
    tolerance = share * float(largest.max())
    outside = exceeding(surface, tolerance)
    assert (largest[~outside] <= tolerance).all()
    assert outside[largest > tolerance].all()
    # and few triangles are blamed wrongly
    assert (largest[outside] > 0.9 * tolerance).mean() > 0.9
    some = np.arange(0, len(largest), 3)
    assert (exceeding(surface, tolerance, some) == outside[some]).all()
    double, second = exceeding(surface, 2.0 * tolerance), np.arange(len(some)) % 2 == 1
    found = exceeding(surface, np.where(second, 2.0, 1.0) * tolerance, some)
    assert (found == np.where(second, double[some], outside[some])).all()


def flat_patch(cells: int = 6) -> Representation:
    """One patch over a plane grid, reproduced exactly."""
    y, x = np.mgrid[0 : cells + 1, 0 : cells + 1] / cells - 0.5
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    surface = approximate(vertices, faces, Settings(workers=1, ring=20)).representation
    assert surface.patches == 1
    return surface


@pytest.mark.parametrize(("i", "j"), [(1, 0), (5, 3), (14, 0), (7, 7)])
def test_the_extremes_of_a_product_of_legendre_polynomials(i: int, j: int) -> None:
    surface = flat_patch()
    place = next(n for n, degrees in enumerate(surface.dictionary.degrees) if tuple(degrees) == (i, j))
    support, coefficients = surface.support.copy(), surface.coefficients.copy()
    support[0, 2], coefficients[0, 2] = -1, 0.0
    support[0, 2, 0], coefficients[0, 2, 0] = place, 1.0
    bumpy = replace(surface, support=support, coefficients=coefficients)
    domain = bumpy.domains[0]
    fine = np.linspace(0.0, 1.0, 401)
    grid = np.array([(1.0 - a - b, a, b) for a in fine[::20] for b in fine[::20] if a + b <= 1.0])
    parameters = np.einsum("qk,skx->sqx", grid, domain[bumpy.corners]).reshape(-1, 2) / 1.05
    heights = legendre.legval(parameters[:, 0], np.eye(i + 1)[i]) * legendre.legval(parameters[:, 1], np.eye(j + 1)[j])
    largest = float(np.abs(heights).max()) / bumpy.scales[0, 0]
    lower, upper = error_bounds(bumpy)
    assert largest <= upper * (1.0 + 1e-9)
    assert lower <= largest * 1.02
    assert upper <= largest * 1.05


def test_distances_from_other_vertices() -> None:
    surface = SURFACES["open, borders pinned"]().representation
    moved = surface.vertices + np.array([0.25, 0.0, 0.0])
    lower, upper = error_bounds(surface, moved)
    largest = float(errors(surface, moved).max())
    assert largest <= upper * (1.0 + 1e-9)
    assert lower <= 1.02 * largest
    untouched = SURFACES["nothing fitted"]().representation
    assert error_bounds(untouched, untouched.vertices + np.array([0.0, 0.0, 2.0])) == pytest.approx((2.0, 2.0))


def test_two_far_vertices_beside_a_fine_sheet() -> None:
    """Triangles ten thousand times as long as their neighbours: what a polynomial does on them no sample tells."""
    y, x = np.mgrid[0:13, 0:13].astype(float)
    number = np.arange(169).reshape(13, 13)
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    sheet = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    fan = [[number[k, 12], 169, number[k + 1, 12]] for k in range(12)]
    vertices = np.vstack([np.column_stack([x.ravel(), y.ravel(), np.sin(x).ravel()]), [[1e4, 6.0, 0.0]]])
    result = approximate(vertices, np.concatenate([sheet, fan]), Settings(workers=1, sweeps=0))
    lower, upper = error_bounds(result.representation)
    assert errors(result.representation).max() <= upper * (1.0 + 1e-9)
    assert upper <= 1.02 * lower


def test_a_model_far_from_the_origin_has_the_same_bounds() -> None:
    vertices, faces = cube(6)
    near = error_bounds(approximate(vertices, faces, Settings(workers=1, creases="off")).representation)
    far = error_bounds(approximate(vertices + 1e4, faces, Settings(workers=1, creases="off")).representation)
    assert far == pytest.approx(near, rel=1e-3)

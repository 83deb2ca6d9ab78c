"""The kernel's evaluation of a surface against polynomials of NumPy and dense sampling."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import legendre, polynomial
from sparse_surface.solver.arrays import Array
from sparse_surface.solver.native import library, surface

SUPPORT = 1.05
DEGREE = 6
PAIRS = [(total - j, j) for total in range(DEGREE + 1) for j in range(total + 1)]

needs_kernel = pytest.mark.skipif(library.reason_against() is not None, reason=str(library.reason_against()))


@pytest.fixture(params=[(1, True), (3, True), (1, False)], ids=["common", "separate", "monomial"])
def functions(request: pytest.FixtureRequest) -> surface.Functions:
    """Functions of four patches; the last place of some coordinates is empty."""
    channels, is_legendre = request.param
    rng = np.random.default_rng(3)
    support = np.stack([rng.permutation(len(PAIRS))[:5] for _ in range(12)]).reshape(4, 3, 5)
    support[1, 2, 4] = support[3, 0, 3:] = -1
    coefficients = np.where(support < 0, 99.0, rng.normal(size=(4, 3, 5)))
    scales = rng.uniform(0.5, 2.0, (4, channels))
    return surface.Functions(support, coefficients, rng.normal(size=(4, 3)), scales, DEGREE, is_legendre)


def value(functions: surface.Functions, patch: int, axis: int, u: Array, v: Array) -> Array:
    """The function of one coordinate, by NumPy's own series."""
    grid = np.zeros((DEGREE + 1, DEGREE + 1))
    for number, coefficient in zip(functions.support[patch, axis], functions.coefficients[patch, axis], strict=True):
        if number >= 0:
            grid[PAIRS[number]] += coefficient
    scale = functions.scales[patch, axis if functions.scales.shape[1] == 3 else 0]
    found = (
        legendre.legval2d(u / SUPPORT, v / SUPPORT, grid) if functions.legendre else polynomial.polyval2d(u, v, grid)
    )
    return np.asarray(found / scale + functions.origins[patch, axis])


@needs_kernel
def test_values_are_those_of_the_series(functions: surface.Functions) -> None:
    channels = functions.scales.shape[1]
    domain = np.random.default_rng(4).uniform(-1.1, 1.1, (channels, 700, 2))
    offsets = np.array([0, 300, 300, 700])
    found = surface.patch_values(functions, 1, offsets, domain)
    for patch, start, stop in ((1, 0, 300), (3, 300, 700)):
        for axis in range(3):
            u, v = domain[axis % channels, start:stop].T
            expected = value(functions, patch, axis, u, v)
            np.testing.assert_allclose(found[start:stop, axis], expected, rtol=1e-11, atol=1e-11)


def two_patches(channels: int, shares: Array | None = None) -> surface.Blend:
    """Two patches over a mesh of two triangles: the second patch has only the second triangle."""
    rng = np.random.default_rng(5)
    return surface.Blend(
        triangle_offsets=np.array([0, 2, 3]),
        mesh_triangles=np.array([0, 1, 1]),
        corners=np.array([[0, 1, 2], [2, 1, 3], [4, 5, 6]]),
        weights=rng.random(7),
        domains=rng.uniform(-1.0, 1.0, (channels, 7, 2)),
        shares=shares,
    )


HOLDERS = surface.Holders(starts=np.array([0, 1, 3]), held=np.array([0, 1, 2]), patch=np.array([0, 0, 1]))
"""Of `two_patches`."""


def weights_at(blend: surface.Blend, triangle: int) -> Array:
    share = 1.0 if blend.shares is None else blend.shares[blend.mesh_triangles[triangle]]
    return share * blend.weights[blend.corners[triangle]]


def blended(functions: surface.Functions, blend: surface.Blend, triangle: int, inside: Array) -> Array:
    total = np.zeros(3)
    for patch in range(2):
        for own in range(*blend.triangle_offsets[patch : patch + 2]):
            if blend.mesh_triangles[own] == triangle:
                places = [inside @ domain[blend.corners[own]] for domain in blend.domains]
                point = [value(functions, patch, axis, *places[axis % len(places)]) for axis in range(3)]
                total += (inside @ weights_at(blend, own)) * np.array(point)
    return total


@needs_kernel
@pytest.mark.parametrize("shares", [None, np.array([0.75, 0.4])], ids=["as they are", "shared"])
def test_the_surface_is_the_weighted_sum_of_its_patches(functions: surface.Functions, shares: Array | None) -> None:
    blend = two_patches(functions.scales.shape[1], shares)
    inside = np.random.default_rng(6).dirichlet([1.0, 1.0, 1.0], 900)
    triangle = np.repeat([0, 1], [400, 500])
    where = np.array([0, 1]), np.array([0, 400, 900])
    points = surface.with_patches(functions, blend, HOLDERS, where, inside.T, np.ones((3, 900))).T
    expected = [1.0 + blended(functions, blend, *query) for query in zip(triangle, inside, strict=True)]
    np.testing.assert_allclose(points, expected, rtol=1e-11, atol=1e-11)


@needs_kernel
def test_tangents_are_differences_of_points(functions: surface.Functions) -> None:
    blend, step = two_patches(functions.scales.shape[1]), 1e-6
    inside = np.random.default_rng(7).dirichlet([3.0, 3.0, 3.0], 40)
    where = np.array([1]), np.array([0, 40])
    points = surface.with_patches(functions, blend, HOLDERS, where, inside.T, np.zeros((9, 40))).T
    for k in (1, 2):
        along = step * (np.eye(3)[k] - np.eye(3)[0])
        ahead, behind = (
            np.array([blended(functions, blend, 1, place) for place in inside + sign * along]) for sign in (1.0, -1.0)
        )
        np.testing.assert_allclose(points[:, 3 * k : 3 * k + 3], (ahead - behind) / (2 * step), rtol=1e-6, atol=1e-6)


@needs_kernel
def test_the_largest_errors_are_those_at_the_samples(functions: surface.Functions) -> None:
    blend = two_patches(functions.scales.shape[1])
    rng = np.random.default_rng(8)
    vertices, triangles = rng.normal(size=(4, 3)), np.array([[0, 1, 2], [2, 1, 3]])
    samples = rng.dirichlet([1.0, 1.0, 1.0], 130)  # two blocks
    found = np.full(3, np.nan)
    for patch in (1, 0):
        surface.largest_errors(functions, blend, (patch, patch + 1), (vertices, triangles), samples, found)
    for own, patch in enumerate((0, 0, 1)):
        places = [samples @ domain[blend.corners[own]] for domain in blend.domains]
        points = np.stack([value(functions, patch, axis, *places[axis % len(places)].T) for axis in range(3)], axis=1)
        flat = samples @ vertices[triangles[blend.mesh_triangles[own]]]
        expected = (np.linalg.norm(points - flat, axis=1) * (samples @ weights_at(blend, own))).max()
        np.testing.assert_allclose(found[own], expected, rtol=1e-11)

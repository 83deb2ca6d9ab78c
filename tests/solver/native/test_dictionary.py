"""The kernel's polynomials against those of NumPy."""

from __future__ import annotations

from ctypes import c_void_p

import numpy as np
import pytest
from numpy.polynomial import legendre, polynomial
from sparse_surface.solver.arrays import Array
from sparse_surface.solver.native.library import function

SUPPORT = 1.05
POINTS = np.linspace(-1.2, 1.2, 37)


def address(array: Array) -> c_void_p:
    return c_void_p(array.ctypes.data)


def tables(degree: int, is_legendre: bool, instructions: str) -> Array:
    table = np.empty((degree + 1, len(POINTS)))
    function("polynomial_tables", instructions)(address(table), address(POINTS), degree, is_legendre, len(POINTS))
    return table


@pytest.mark.parametrize("degree", [0, 1, 2, 14, 30])
def test_tables_are_legendre_polynomials(instructions: str, degree: int) -> None:
    expected = legendre.legvander(POINTS / SUPPORT, degree).T
    np.testing.assert_allclose(tables(degree, True, instructions), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("degree", [0, 1, 14, 30])
def test_tables_are_powers(instructions: str, degree: int) -> None:
    expected = polynomial.polyvander(POINTS, degree).T
    np.testing.assert_allclose(tables(degree, False, instructions), expected, rtol=1e-12)


@pytest.mark.parametrize("is_legendre", [True, False])
def test_derivatives(instructions: str, is_legendre: bool) -> None:
    degree = 14
    table, slope = tables(degree, is_legendre, instructions), np.empty((degree + 1, len(POINTS)))
    function("derivative_tables", instructions)(address(slope), address(table), degree, is_legendre, len(POINTS))
    for k in range(degree + 1):
        series = (legendre.Legendre if is_legendre else polynomial.Polynomial).basis(k)
        stretch = SUPPORT if is_legendre else 1.0
        np.testing.assert_allclose(slope[k], series.deriv()(POINTS / stretch) / stretch, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("degree", [0, 1, 5, 30])
def test_products_of_legendre_polynomials_are_sums_of_them(instructions: str, degree: int) -> None:
    coefficients = np.empty((degree + 1, degree + 1, degree + 1))
    function("product_coefficients", instructions)(address(coefficients), degree, True)
    for i in range(degree + 1):
        for k in range(degree + 1):
            expected = legendre.legmul([0.0] * i + [1.0], [0.0] * k + [1.0])
            own = np.zeros(i + k + 1)
            own[i + k - 2 * np.arange(min(i, k) + 1)] = coefficients[i, k, : min(i, k) + 1]
            np.testing.assert_allclose(own, expected, atol=1e-12)
            assert not coefficients[i, k, min(i, k) + 1 :].any()

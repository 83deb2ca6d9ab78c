"""The dictionary against NumPy's polynomials, finite differences and a sum term by term."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import legendre, polynomial
from sparse_surface.solver.fitting.dictionary import LEGENDRE_SUPPORT, Dictionary, coefficient_grid, combine

BASES = ("monomial", "legendre")
POINTS = np.random.default_rng(1).uniform(-1.2, 1.2, (2, 40))


def one_function(basis: str, i: int, j: int, domain: np.ndarray) -> np.ndarray:
    """Return q_i(u) q_j(v) from NumPy's evaluation of two-variable series."""
    series = np.zeros((i + 1, j + 1))
    series[i, j] = 1.0
    if basis == "legendre":
        return legendre.legval2d(*(domain / LEGENDRE_SUPPORT), series)
    return polynomial.polyval2d(*domain, series)


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("degree", [0, 1, 2, 14])
def test_holds_every_function_up_to_the_degree_once(basis: str, degree: int) -> None:
    degrees = [tuple(pair) for pair in Dictionary(degree, basis).degrees]
    assert sorted(degrees) == sorted((i, t - i) for t in range(degree + 1) for i in range(t + 1))
    assert len(degrees) == Dictionary(degree, basis).size == (degree + 1) * (degree + 2) // 2


@pytest.mark.parametrize("basis", BASES)
def test_numbers_functions_by_total_degree_so_that_a_smaller_dictionary_is_a_beginning(basis: str) -> None:
    large, small = Dictionary(14, basis), Dictionary(7, basis)
    assert (np.diff(large.degrees.sum(axis=1)) >= 0).all()
    np.testing.assert_array_equal(large.degrees[: small.size], small.degrees)
    np.testing.assert_array_equal(large.evaluate(POINTS)[: small.size], small.evaluate(POINTS))


@pytest.mark.parametrize("basis", BASES)
def test_values_are_those_of_numpy(basis: str) -> None:
    dictionary = Dictionary(14, basis)
    values = dictionary.evaluate(POINTS)
    for number, (i, j) in enumerate(dictionary.degrees):
        np.testing.assert_allclose(values[number], one_function(basis, i, j, POINTS), rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("basis", BASES)
def test_evaluates_batches_as_it_does_single_patches(basis: str) -> None:
    dictionary = Dictionary(6, basis)
    domain = np.random.default_rng(2).uniform(-1, 1, (2, 3, 4, 25))
    values = dictionary.evaluate(domain)
    assert values.shape == (3, 4, dictionary.size, 25)
    np.testing.assert_array_equal(values[1, 2], dictionary.evaluate(domain[:, 1, 2]))


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("degree", [0, 1, 2, 14])
def test_derivatives_agree_with_finite_differences(basis: str, degree: int) -> None:
    dictionary = Dictionary(degree, basis)
    x, step = POINTS[0], 1e-6
    slopes = dictionary.derivative_tables(dictionary.tables(x))
    differences = (dictionary.tables(x + step) - dictionary.tables(x - step)) / (2 * step)
    np.testing.assert_allclose(slopes, differences, rtol=1e-7, atol=1e-7 * np.abs(differences).max(initial=1.0))


@pytest.mark.parametrize("basis", BASES)
@given(seed=st.integers(0, 2**32 - 1), size=st.integers(1, 15))
def test_sparse_combinations_agree_with_the_sum_of_their_terms(basis: str, seed: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    dictionary = Dictionary(8, basis)
    support = np.stack([rng.choice(dictionary.size, size, replace=False) for _ in range(3)])
    coefficients = rng.normal(size=(3, size))
    domain = rng.uniform(-1, 1, (2, 20))
    expected = np.stack([c @ dictionary.evaluate(domain)[s] for s, c in zip(support, coefficients, strict=True)])
    np.testing.assert_allclose(dictionary.sparse_values(support, coefficients, domain), expected, atol=1e-12)


def test_unused_places_add_nothing() -> None:
    dictionary = Dictionary(5, "monomial")
    support, coefficients = np.array([[4, 7, -1, -1]]), np.array([[0.5, -2.0, 0.0, 0.0]])
    shorter = dictionary.sparse_values(support[:, :2], coefficients[:, :2], POINTS)
    np.testing.assert_array_equal(dictionary.sparse_values(support, coefficients, POINTS), shorter)


def test_a_function_that_stands_twice_counts_twice() -> None:
    grid = coefficient_grid(Dictionary(3, "monomial").degrees, np.array([2, 2]), np.array([1.0, 0.25]), 3)
    assert grid[0, 1] == 1.25
    assert np.count_nonzero(grid) == 1


@pytest.mark.parametrize("basis", BASES)
def test_combine_gives_gradients_too(basis: str) -> None:
    dictionary = Dictionary(7, basis)
    rng = np.random.default_rng(3)
    grid = coefficient_grid(dictionary.degrees, rng.permutation(dictionary.size)[:9], rng.normal(size=9), 7)
    step = 1e-6

    def height(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return combine(grid, dictionary.tables(u), dictionary.tables(v))

    u, v = POINTS
    u_table, v_table = dictionary.tables(u), dictionary.tables(v)
    along_u = combine(grid, dictionary.derivative_tables(u_table), v_table)
    along_v = combine(grid, u_table, dictionary.derivative_tables(v_table))
    np.testing.assert_allclose(along_u, (height(u + step, v) - height(u - step, v)) / (2 * step), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(along_v, (height(u, v + step) - height(u, v - step)) / (2 * step), rtol=1e-6, atol=1e-6)


def test_names_read_like_the_functions() -> None:
    assert Dictionary(2, "monomial").names() == ["1", "u", "v", "u^2", "u v", "v^2"]
    assert Dictionary(2, "legendre").names() == ["1", "P1(u)", "P1(v)", "P2(u)", "P1(u) P1(v)", "P2(v)"]

"""The dictionary of basis functions: all bivariate polynomials of total degree <= t (eq. 1).

A function is the product of two one-variable polynomials, p(u, v) = q_i(u) q_j(v) with i + j <= t.  Arrays keep
functions before points, so that selecting functions copies whole rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array, Indices

LEGENDRE_SUPPORT = 1.05
"""Legendre polynomials are stretched to [-1.05, 1.05], as the optimised domain may slightly leave [-1, 1]."""


@dataclass(frozen=True)
class Dictionary:
    """All products q_i(u) q_j(v) of total degree i + j <= `degree`.

    Attributes
    ----------
    degree
        Highest total degree t.
    basis
        "legendre" or "monomial".
    """

    degree: int
    basis: str

    @cached_property
    def degrees(self) -> Indices:
        """Degrees (i, j) of the functions, (n, 2), ordered by total degree."""
        pairs = [(total - j, j) for total in range(self.degree + 1) for j in range(total + 1)]
        return np.array(pairs, dtype=np.int64)

    @property
    def size(self) -> int:
        """Number of functions, n = (t + 1)(t + 2) / 2."""
        return (self.degree + 1) * (self.degree + 2) // 2

    def names(self) -> list[str]:
        """Readable names of the functions, such as "P2(u) P1(v)" or "u^2 v"."""
        return [self._name(int(i), int(j)) for i, j in self.degrees]

    def _name(self, i: int, j: int) -> str:
        if self.basis == "legendre":
            factors = [f"P{k}({x})" for k, x in ((i, "u"), (j, "v")) if k]
        else:
            factors = [x if k == 1 else f"{x}^{k}" for k, x in ((i, "u"), (j, "v")) if k]
        return " ".join(factors) or "1"

    def tables(self, parameter: Array) -> Array:
        """Values of the one-variable polynomials q_0 .. q_t.

        Parameters
        ----------
        parameter
            One parameter, u or v, of every point, shape (..., N).

        Returns
        -------
        ndarray
            Shape (..., t + 1, N).
        """
        x = parameter / LEGENDRE_SUPPORT if self.basis == "legendre" else parameter
        # The degree comes first in memory, so every step of the recursion runs over contiguous memory.
        table = np.empty((self.degree + 1, *x.shape))
        lower = np.empty_like(x)
        table[0] = 1.0
        if self.degree >= 1:
            table[1] = x
        for k in range(1, self.degree):
            np.multiply(x, table[k], out=table[k + 1])
            if self.basis == "legendre":
                # Bonnet's recursion
                table[k + 1] *= (2 * k + 1) / (k + 1)
                np.multiply(table[k - 1], k / (k + 1), out=lower)
                table[k + 1] -= lower
        return np.moveaxis(table, 0, -2)

    def derivative_tables(self, table: Array) -> Array:
        """First derivatives of the one-variable polynomials, from their values.

        Parameters
        ----------
        table
            What `tables` returned, (..., t + 1, N).

        Returns
        -------
        ndarray
            Shape (..., t + 1, N).
        """
        slope = np.empty_like(table)
        slope[..., 0, :] = 0.0
        for k in range(1, self.degree + 1):
            if self.basis == "legendre":
                # P'_k = P'_{k-2} + (2k - 1) P_{k-1}, chain rule for the stretched support
                np.multiply(table[..., k - 1, :], (2 * k - 1) / LEGENDRE_SUPPORT, out=slope[..., k, :])
                if k >= 2:
                    slope[..., k, :] += slope[..., k - 2, :]
            else:
                np.multiply(table[..., k - 1, :], k, out=slope[..., k, :])
        return slope

    @cached_property
    def derivative_matrix(self) -> Array:
        """First derivatives of the one-variable polynomials in terms of these polynomials, (t + 1, t + 1)."""
        return self.derivative_tables(np.eye(self.degree + 1))

    def evaluate(self, domain: Array) -> Array:
        """Values of every function.

        Parameters
        ----------
        domain
            Parameters (2, ..., N): u first, then v.

        Returns
        -------
        ndarray
            Shape (..., n, N).
        """
        return self.products(*self.tables(domain))

    def products(self, u_table: Array, v_table: Array) -> Array:
        """Values of every function, (..., n, N), from those of the one-variable polynomials, (..., t + 1, N) both."""
        values = np.empty((*u_table.shape[:-2], self.size, u_table.shape[-1]))
        for total in range(self.degree + 1):
            first = total * (total + 1) // 2
            same_total = values[..., first : first + total + 1, :]
            np.multiply(u_table[..., total::-1, :], v_table[..., : total + 1, :], out=same_total)
        return values

    def sparse_values(self, support: Indices, coefficients: Array, domain: Array) -> Array:
        """Values of sparse combinations of the functions.

        Parameters
        ----------
        support, coefficients
            Chosen functions and their coefficients, (..., s).
        domain
            Parameters (2, ..., N), broadcast against the leading axes of `support`.

        Returns
        -------
        ndarray
            Shape (..., N).
        """
        grid = coefficient_grid(self.degrees, support, coefficients, self.degree)
        return combine(grid, *self.tables(domain))


def coefficient_grid(degrees: Indices, support: Indices, coefficients: Array, degree: int) -> Array:
    """Spread sparse coefficients over the (t + 1) x (t + 1) grid of degrees (i, j).

    With the grid C the function is h = sum_i q_i(u) (C q(v))_i: two small matrix products for any selection.

    Parameters
    ----------
    degrees
        Degrees of the dictionary's functions, (n, 2).
    support
        Selected functions, (..., s).  If a function occurs twice, its coefficients add up.
    coefficients
        Their coefficients, (..., s).
    degree
        Highest total degree t.

    Returns
    -------
    ndarray
        Shape (..., t + 1, t + 1).
    """
    leading, size = support.shape[:-1], (degree + 1) ** 2
    rows = int(np.prod(leading))
    place = (degrees[support, 0] * (degree + 1) + degrees[support, 1]).reshape(rows, support.shape[-1])
    place += size * np.arange(rows)[:, None]
    grid = np.bincount(place.ravel(), weights=np.ravel(coefficients), minlength=rows * size)
    return grid.reshape(*leading, degree + 1, degree + 1).astype(np.float64, copy=False)


def combine(grid: Array, u_table: Array, v_table: Array) -> Array:
    """Value of h = sum_ij C_ij q_i(u) q_j(v).

    Parameters
    ----------
    grid
        Coefficients C, (..., t + 1, t + 1).
    u_table, v_table
        Values (or derivatives) of the one-variable polynomials, (..., t + 1, N), broadcast against `grid`.

    Returns
    -------
    ndarray
        Shape (..., N).
    """
    total: Array = np.einsum("...in,...in->...n", np.matmul(grid, v_table), u_table)
    return total

"""Taylor models of a patch's functions: polynomials of low degree, and how far the functions can be from them.

About the centre of a triangle in the parameter plane a function h is its Taylor polynomial of degree m - 1.  By
Lagrange's form of the remainder what that leaves out is at most

    r = sum_{a + b = m} max |d^m h / du^a dv^b| / (a! b!) * du^a dv^b

where du and dv are the triangle's extents from its centre.  A function is a sum of products q_i(u) q_j(v), so sums of
products of the largest derivatives of q_i and q_j over the triangle's extents bound the maxima; those are tabulated.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.typing import NDArray

from ..fitting.dictionary import Dictionary

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

ORDER, ROUGH_ORDER = 6, 3
"""m: degree of the polynomials that stand for the error, and of those that find the triangles where it may be large."""

CELLS, SAMPLES_A_CELL = 256, 8
"""Intervals into which the range of the parameters is cut, and samples of a polynomial in each."""


def _lattice(order: int) -> Indices:
    return np.array([[order - i - j, i, j] for i in range(order + 1) for j in range(order + 1 - i)])


def _to_bernstein(order: int) -> Array:
    """Matrix that takes a polynomial's values at the lattice to its Bernstein coefficients."""
    exponents = _lattice(order)
    count = [factorial(order) / np.prod([factorial(e) for e in row]) for row in exponents]
    places = exponents[:, None, :] / order
    return np.linalg.inv(np.array(count) * np.prod(places ** exponents[None], axis=2))


@dataclass(frozen=True, eq=False)
class Lattice:
    """The points that fix a polynomial of degree m on a triangle, corners included.

    Attributes
    ----------
    order
        m.
    places
        Their barycentric coordinates, (n, 3).
    to_bernstein
        Takes a polynomial's values there to its Bernstein coefficients, (n, n).
    """

    order: int
    places: Array
    to_bernstein: Array

    @classmethod
    def of(cls, order: int) -> Lattice:
        return cls(order, _lattice(order) / order, _to_bernstein(order))


LATTICE, ROUGH_LATTICE = Lattice.of(ORDER), Lattice.of(ROUGH_ORDER)


class Expansions:
    """Taylor polynomials of dictionary functions about the centres of n triangles in the plane."""

    def __init__(self, dictionary: Dictionary, triangles: Array, limits: DerivativeBounds, lattice: Lattice) -> None:
        """Take the triangles' corners, (n, 3, 2); the polynomials are of degree m - 1 for the lattice's m."""
        self._order = order = lattice.order
        centre = triangles.mean(axis=1)
        away = triangles - centre[:, None]
        extent = np.abs(away).max(axis=1)
        at_lattice = np.matmul(lattice.places, away)
        self._powers = [np.stack(_powers(at_lattice[:, :, axis], order)) for axis in (0, 1)]
        self._extents = [np.stack(_powers(extent[:, axis], order + 1)) for axis in (0, 1)]
        self._tables = [_derivatives(dictionary, np.ascontiguousarray(centre[:, axis]), order) for axis in (0, 1)]
        low, high = triangles.min(axis=1), triangles.max(axis=1)
        self._limits = [limits.over(low[:, axis], high[:, axis], order) for axis in (0, 1)]

    def of_patches(self, runs: Indices, grids: Array) -> tuple[Array, Array]:
        """Values at the lattice, (n, D, L), and remainders, (n, D), of D functions for each run of triangles.

        Parameters
        ----------
        runs
            Run k has the triangles from `runs[k]` to `runs[k + 1]`, (K + 1,).
        grids
            Each run's coefficients by the degrees of their functions, (K, D, t + 1, t + 1).
        """
        order, signals, count = self._order, grids.shape[1], self._extents[0].shape[1]
        slopes, largest = np.empty((order, count, signals, order)), np.empty((order + 1, signals, count))
        for grid, first, stop in zip(grids, runs, runs[1:], strict=False):
            rows = slice(first, stop)
            (u, v), (most_u, most_v) = ([own[..., rows] for own in tables] for tables in (self._tables, self._limits))
            along = np.matmul(grid, v[:, None])
            for a in range(order):
                slopes[a, rows, :, : order - a] = np.einsum("bdin,in->ndb", along[: order - a], u[a])
            most = np.matmul(np.abs(grid), most_v[:, None])
            np.einsum("bdin,bin->bdn", most, most_u[::-1], out=largest[:, :, rows])
        values = np.zeros((count, signals, self._powers[0].shape[2]))
        for a in range(order):
            along_v = np.matmul(slopes[a, :, :, : order - a], self._powers[1][: order - a].transpose(1, 0, 2))
            values += along_v * self._powers[0][a][:, None]
        extents = self._extents[0][::-1] * self._extents[1]
        return values, np.einsum("bdn,bn->nd", largest, extents)


def _powers(x: Array, count: int) -> list[Array]:
    """x^a / a! for a < count."""
    powers = [np.ones_like(x)]
    for a in range(1, count):
        powers.append(powers[-1] * x / a)
    return powers


def _derivatives(dictionary: Dictionary, x: Array, count: int) -> Array:
    """Derivatives of order 0 .. count - 1 of the one-variable polynomials, (count, t + 1, n)."""
    tables = np.empty((count, dictionary.degree + 1, len(x)))
    tables[0] = dictionary.tables(x)
    for a in range(1, count):
        np.matmul(dictionary.derivative_matrix, tables[a - 1], out=tables[a])
    return tables


@dataclass(frozen=True)
class DerivativeBounds:
    """Largest absolute derivatives of the one-variable polynomials over intervals.

    Attributes
    ----------
    low, width
        Where the cells begin, and how long each is.
    levels
        Maxima over 2^level cells from each cell on, of the derivatives of order 0 .. m, (levels, m + 1, cells, t + 1).
    """

    low: float
    width: float
    levels: Array

    @classmethod
    def of(cls, dictionary: Dictionary, domains: Array) -> DerivativeBounds:
        low, high = (float(domains.min()), float(domains.max())) if domains.size else (-1.0, 1.0)
        high = max(high, low + 1e-9)
        step = (high - low) / (CELLS * SAMPLES_A_CELL)
        tables = _derivatives(dictionary, np.linspace(low, high, CELLS * SAMPLES_A_CELL + 1), dictionary.degree + 1)
        above = np.zeros((dictionary.degree + 1, CELLS))
        found = []
        # From the highest derivative, which is constant, down: between samples a function changes by at most half a
        # step times the bound of its derivative.
        for table in tables[::-1]:
            most = np.maximum(np.abs(table[:, :-1]), np.abs(table[:, 1:]))
            above = most.reshape(len(most), CELLS, SAMPLES_A_CELL).max(axis=2) + 0.5 * step * above
            found.append(above)
        none = np.zeros_like(above)
        orders = np.stack([found[-1 - a] if a < len(found) else none for a in range(ORDER + 1)]).swapaxes(1, 2)
        return cls(low, (high - low) / CELLS, _running_maxima(orders))

    def over(self, low: Array, high: Array, order: int) -> Array:
        """Bounds over intervals (n,), for each order up to one, (order + 1, t + 1, n)."""
        first, last = (np.clip(((x - self.low) / self.width).astype(np.int64), 0, CELLS - 1) for x in (low, high))
        level = np.log2(last - first + 1).astype(np.int64)
        second = last + 1 - (1 << level)
        found = np.empty((order + 1, self.levels.shape[-1], len(low)))
        for a, most in enumerate(found):
            np.maximum(self.levels[level, a, first].T, self.levels[level, a, second].T, out=most)
        return found


def _running_maxima(values: Array) -> Array:
    """Maxima over 1, 2, 4, ... cells from each on (the last ones over fewer), (levels, ..., cells, t + 1)."""
    levels = [values]
    width = 1
    while 2 * width <= values.shape[-2]:
        longer = levels[-1].copy()
        longer[..., :-width, :] = np.maximum(longer[..., :-width, :], levels[-1][..., width:, :])
        levels.append(longer)
        width *= 2
    return np.stack(levels)

"""Patches made on the spot: jittered grids with a surface over them, as problems of the patch solvers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from sparse_surface.solver.fitting.batch import Problem

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def crease(u: Array, v: Array) -> Array:
    """Return a roof whose ridge runs aslant: on a ridge along an axis few monomials would be exact."""
    return -0.6 * np.abs(0.8 * u + 0.6 * v + 0.1)


def hill(u: Array, v: Array) -> Array:
    return 0.4 * np.exp(-2.0 * (u**2 + 0.5 * v**2)) + 0.1 * np.sin(2.0 * u - v)


def grid(side: int, seed: int) -> tuple[Array, Indices]:
    """Return a jittered grid on [-1, 1]^2 of `side` x `side` vertices, and its triangles, counter-clockwise."""
    rng = np.random.default_rng(seed)
    row, column = np.divmod(np.arange(side * side), side)
    points = np.column_stack((column, row)) * 2.0 / (side - 1) - 1.0
    points += rng.uniform(-0.25, 0.25, points.shape) * 2.0 / (side - 1)
    number = np.arange(side * side).reshape(side, side)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    return points, np.concatenate([np.column_stack((a, b, c)), np.column_stack((a, c, d))])


def problem(
    height: Callable[[Array, Array], Array] = crease,
    side: int = 10,
    seed: int = 0,
    *,
    scale: float = 1.0,
    inside: bool = False,
    weights: Array | None = None,
    degree: int = 14,
) -> Problem:
    """Return a patch with the signals x, y, z: a surface over a grid, its domain turned and moved somewhere."""
    domain, triangles = grid(side, seed)
    signals = np.column_stack((domain, height(*domain.T))) * scale
    corners, shares = np.repeat(np.arange(len(domain)), 3).reshape(-1, 3), np.tile([1.0, 0.0, 0.0], (len(domain), 1))
    if inside:
        corners = np.concatenate([corners, triangles])
        shares = np.concatenate([shares, np.full(triangles.shape, 1.0 / 3.0)])
    values = np.einsum("nkd,nk->nd", signals[corners], shares)
    own = (
        np.concatenate([np.ones(len(domain)), np.full(len(values) - len(domain), 0.5)]) if weights is None else weights
    )
    turn = np.array([[0.6, 0.8], [-0.8, 0.6]])
    return Problem(domain @ turn * scale + [3.0, -2.0], triangles, signals, corners, shares, values, own, degree)

"""Sparse Hermitian systems of many separate blocks, one a patch, solved together."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, solveh_banded
from scipy.sparse import csc_array, csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

from ..arrays import Booleans, Indices

_WIDEST_BAND = 80  # beyond that a general sparse factorisation is faster


def solve_held(matrix: csr_array, held: Booleans, values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Minimise the quadratic form of a Hermitian block-diagonal matrix with some values held."""
    result = np.where(held, values, 0.0)
    if held.all():
        return result
    ordered = reverse_cuthill_mckee(matrix, symmetric_mode=True)
    free = ordered[~held[ordered]]
    result[free] = _solve_positive(matrix, free, -(matrix @ result)[free])
    return result


def _solve_positive(matrix: csr_array, order: Indices, right: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Solve the rows and columns `order` of a positive definite matrix.

    Small patches make a narrow band, in which Cholesky's factorisation is faster than a general sparse one.
    """
    position = np.full(matrix.shape[0], -1, dtype=np.int64)
    position[order] = np.arange(len(order))
    row, column = np.repeat(position, np.diff(matrix.indptr)), position[matrix.indices]
    upper = (row >= 0) & (column >= row)
    row, column = row[upper], column[upper]
    width = int((column - row).max())
    if width <= _WIDEST_BAND:
        band = np.zeros((width + 1, len(order)), dtype=matrix.dtype, order="F")
        band[width + row - column, column] = matrix.data[upper]
        try:
            return _with_real_matrix(lambda sides: solveh_banded(band, sides, check_finite=False), matrix, right)
        except LinAlgError:
            pass  # rounding made it indefinite
    factor = splu(
        csc_array(matrix[order][:, order]),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return _with_real_matrix(factor.solve, matrix, right)


def _with_real_matrix(
    solve: Callable[[NDArray[Any]], NDArray[Any]], matrix: csr_array, right: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Solve for a complex right side, as two real ones where the matrix is real."""
    if matrix.dtype.kind == "c":
        return np.asarray(solve(right), dtype=np.complex128)
    both = solve(np.stack((right.real, right.imag), axis=1))
    return np.asarray(both[:, 0] + 1j * both[:, 1], dtype=np.complex128)

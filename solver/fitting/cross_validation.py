"""Automatic sparsity: how many functions a signal needs, by cross-validation.

A pursuit on part of the observations is judged on the held-out rest, for every number of functions at once: the choices
of a pursuit are nested, so one Cholesky factor gives all the fits.  scikit-learn's `OrthogonalMatchingPursuitCV` does
the same for a single signal.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Booleans, Indices
from .pursuit import least_squares_pursuit

FOLDS = 5
RIDGE = 1e-10


def validated_sparsity(functions: Array, values: Array, most: int, allowed: Booleans) -> Indices:
    """Number k of functions with the least squared error on held-out observations, argmin_k sum_folds |b - h_k|^2.

    Parameters
    ----------
    functions
        Dictionary at the observations, weighted, (B, n, N).
    values
        Signals, weighted, (B, D, N).
    most
        Largest number of functions.
    allowed
        Functions that may be chosen, (B, n).

    Returns
    -------
    ndarray
        (B, D), from 1 to `most`.
    """
    error = np.zeros((*values.shape[:2], most))
    for fold in range(FOLDS):
        held_out = np.arange(values.shape[2]) % FOLDS == fold
        error += _held_out_error(functions, values, most, allowed, held_out)
    return error.argmin(axis=2) + 1


def _held_out_error(functions: Array, values: Array, most: int, allowed: Booleans, held_out: Booleans) -> Array:
    """Squared error on the held-out observations with 1 .. `most` functions, (B, D, most)."""
    # `compress` keeps the memory layout that matrix products need; indexing with a mask would not
    known, asked = np.compress(~held_out, functions, axis=2), np.compress(held_out, functions, axis=2)
    gram = np.matmul(known, known.transpose(0, 2, 1))
    correlation = np.matmul(np.compress(~held_out, values, axis=2), known.transpose(0, 2, 1))
    support = least_squares_pursuit(gram, correlation, most, allowed, replacements=0)
    used = support >= 0
    patch = np.arange(len(functions))[:, None, None]
    among = gram[patch[..., None], support[..., :, None], support[..., None, :]]
    among *= used[..., :, None] & used[..., None, :]
    size = np.where(used, np.diagonal(among, axis1=-2, axis2=-1), 1.0)
    among[..., np.arange(most), np.arange(most)] = size * (1.0 + RIDGE)
    factor = np.linalg.cholesky(among)
    own = np.take_along_axis(correlation, support, axis=2) * used
    steps = np.linalg.solve(factor, own[..., None])
    directions = np.linalg.solve(factor, asked[patch, support] * used[..., None])
    predicted = np.cumsum(steps * directions, axis=2)
    squared: Array = ((np.compress(held_out, values, axis=2)[:, :, None] - predicted) ** 2).sum(axis=3)
    return squared

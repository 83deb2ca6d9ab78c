"""The sparse fit over given domains: choose at most s functions for each signal, then solve least squares (eq. 2).

For each signal b and domain U it minimises sum_i w_i (b_i - sum_j c_j p_j(u_i))^2 with |c|_0 <= s.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Booleans, Indices
from .batch import Batch
from .cross_validation import validated_sparsity
from .dictionary import Dictionary
from .pursuit import PURSUITS

RIDGE = 1e-11
"""Added to the diagonal of the scaled Gram matrices, so that their Cholesky factors exist."""
NEGLIGIBLE = 1e-8
"""Lengths of functions count as at least this share of the longest chosen one."""


@dataclass(frozen=True)
class Fit:
    """Least squares of a batch's signals on chosen functions over given domains.

    Attributes
    ----------
    support
        Chosen functions, (B, D, s); -1 where fewer were chosen.
    coefficients
        (B, D, s); zero where the support is -1.
    functions
        Weighted values of the chosen functions at the observations, (B, D, s, N).
    inverse_factor
        Inverse of the lower Cholesky factor of their Gram matrices, (B, D, s, s).
    residual
        Weighted residual at the observations, (B, D, N).
    tables
        Values of the one-variable polynomials at u, and weighted ones at v, (2, B, t + 1, N).
    """

    support: Indices
    coefficients: Array
    functions: Array
    inverse_factor: Array
    residual: Array
    tables: Array

    @property
    def misfit(self) -> Array:
        """Weighted sum of squares for each problem, (B,)."""
        return np.einsum("bdn,bdn->b", self.residual, self.residual)

    @property
    def orthonormal(self) -> Array:
        """Rows that span the weighted functions, (B, D, s, N)."""
        return np.matmul(self.inverse_factor, self.functions)

    def only(self, which: Indices) -> Fit:
        """Some of the problems."""
        taken = {name: getattr(self, name)[which] for name in ("support", *_CHANGING)}
        return Fit(**taken, tables=self.tables[:, which])

    def put(self, which: Indices, other: Fit, theirs: Indices) -> None:
        """Overwrite the problems `which` by the problems `theirs` of `other`, which have the same support."""
        for name in _CHANGING:
            getattr(self, name)[which] = getattr(other, name)[theirs]
        self.tables[:, which] = other.tables[:, theirs]


_CHANGING = ("coefficients", "functions", "inverse_factor", "residual")
"""What changes, problem by problem, when the domain of a fit does; the tables change too."""


def refined_coefficients(fit: Fit) -> Array:
    """Coefficients after one step of iterative refinement, (B, D, s), which undoes the effect of the ridge."""
    share = np.matmul(fit.inverse_factor, np.matmul(fit.functions, fit.residual[..., None]))
    refined: Array = fit.coefficients + np.matmul(fit.inverse_factor.swapaxes(-1, -2), share)[..., 0]
    return refined


def select(batch: Batch, dictionary: Dictionary, domain: Array, sparsity: int, pursuit: str) -> Fit:
    """Choose the functions for the given domains and fit them.

    Parameters
    ----------
    domain
        (2, B, m), in the problems' frames.
    sparsity
        Largest number of functions of a signal, s.
    pursuit
        A name in `pursuit.PURSUITS`.
    """
    gram, correlation = _normal_equations(batch, dictionary, domain)
    allowed = _allowed(batch, dictionary)
    # the largest gain that the best function is expected to have on noise alone
    worth = 2.0 * np.log(np.maximum(allowed.sum(axis=1), 2)) * batch.noise
    support = PURSUITS[pursuit](gram, correlation, _most(batch, allowed, sparsity), allowed, worth=worth)
    return least_squares(batch, dictionary, domain, support)


def select_validated(batch: Batch, dictionary: Dictionary, domain: Array, sparsity: int, pursuit: str) -> Fit:
    """Like `select`, with the number of functions of each signal, up to `sparsity`, chosen by cross-validation."""
    allowed = _allowed(batch, dictionary)
    most = _most(batch, allowed, sparsity)
    weighted = dictionary.evaluate(batch.observed(domain)) * batch.root_weights
    wanted = validated_sparsity(weighted, batch.values * batch.root_weights, most, allowed)
    gram, correlation = _normal_equations(batch, dictionary, domain)
    support = np.full((*wanted.shape, most), -1, dtype=np.int64)
    for count in np.unique(wanted):
        problem, signal = np.nonzero(wanted == count)
        chosen = PURSUITS[pursuit](gram[problem], correlation[problem, signal][:, None], int(count), allowed[problem])
        support[problem, signal, :count] = chosen[:, 0]
    return least_squares(batch, dictionary, domain, support)


def _normal_equations(batch: Batch, dictionary: Dictionary, domain: Array) -> tuple[Array, Array]:
    """Gram matrices of the weighted dictionary (B, n, n), and its correlations with the weighted signals (B, D, n).

    One problem at a time: the values of the whole dictionary at its observations just fit into the cache.
    """
    u_tables, v_tables = _weighted_tables(batch, dictionary, domain)
    values = batch.values * batch.root_weights
    gram = np.empty((batch.problems, dictionary.size, dictionary.size))
    correlation = np.empty((*values.shape[:2], dictionary.size))
    for k, (u, v) in enumerate(zip(u_tables, v_tables, strict=True)):
        functions = dictionary.products(u, v)
        np.matmul(functions, functions.T, out=gram[k])
        np.matmul(values[k], functions.T, out=correlation[k])
    return gram, correlation


def _weighted_tables(batch: Batch, dictionary: Dictionary, domain: Array) -> Array:
    """Values of the one-variable polynomials at u, and weighted ones at v, (2, B, t + 1, N)."""
    tables = dictionary.tables(batch.observed(domain))
    tables[1] *= batch.root_weights
    return tables


def _allowed(batch: Batch, dictionary: Dictionary) -> Booleans:
    """Functions that each problem may use, (B, n)."""
    return dictionary.degrees.sum(axis=1) <= batch.degrees[:, None]


def _most(batch: Batch, allowed: Booleans, sparsity: int) -> int:
    """Largest number of functions of a signal: with more of them than observations they would depend on each other."""
    return min(sparsity, int(allowed.sum(axis=1).max()), batch.values.shape[-1])


def generalisation_score(batch: Batch, fit: Fit) -> Array:
    """Generalised cross-validation score of each problem, (B,): misfit / (N - number of functions)^2.

    It prefers the lower misfit between fits with as many functions (Golub, Heath, Wahba 1979).
    """
    observations = (batch.root_weights[:, 0] > 0.0).sum(axis=1) * fit.residual.shape[1]
    functions = (fit.support >= 0).sum(axis=(1, 2))
    score: Array = fit.misfit / np.maximum(observations - functions, 1) ** 2
    return score


def as_wide_as(fit: Fit, support: Indices) -> Indices:
    """Chosen functions (B, D, any) with as many places as those of `fit`.

    An earlier batch may have held patches that can use more functions, or fewer: places cut off or added are -1.
    """
    wide = np.full_like(fit.support, -1)
    width = min(wide.shape[-1], support.shape[-1])
    wide[..., :width] = support[..., :width]
    return wide


def merge(first: Booleans, one: Fit, other: Fit) -> Fit:
    """Take each problem from `one` where `first` holds, from `other` elsewhere."""
    if first.all():
        return one

    def pick(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
        return np.where(first.reshape(-1, *[1] * (a.ndim - 1)), a, b)

    return Fit(
        pick(one.support, other.support),
        pick(one.coefficients, other.coefficients),
        pick(one.functions, other.functions),
        pick(one.inverse_factor, other.inverse_factor),
        pick(one.residual, other.residual),
        np.stack([pick(one.tables[k], other.tables[k]) for k in (0, 1)]),
    )


def least_squares(batch: Batch, dictionary: Dictionary, domain: Array, support: Indices) -> Fit:
    """Fit given functions over given domains, by a Cholesky factor of the column-scaled Gram matrix.

    Parameters
    ----------
    domain
        (2, B, m), in the problems' frames.
    support
        Functions of each signal, (B, D, s); -1 for none.
    """
    tables = _weighted_tables(batch, dictionary, domain)
    functions = _chosen(dictionary, support, tables)
    gram = np.matmul(functions, functions.swapaxes(-1, -2))
    norm = np.sqrt(np.diagonal(gram, axis1=-2, axis2=-1))
    # New weights may leave nothing of a function: it must not get a huge coefficient for that.
    norm = np.maximum(norm, NEGLIGIBLE * norm.max(axis=-1, keepdims=True))
    norm = np.where(norm > 0.0, norm, 1.0)
    gram /= norm[..., :, None] * norm[..., None, :]
    size = support.shape[-1]
    # Unused places get a unit diagonal, so that every problem has the same shape.
    gram[..., np.arange(size), np.arange(size)] = 1.0 + RIDGE
    inverse_factor = np.linalg.inv(np.linalg.cholesky(gram)) / norm[..., None, :]
    values = batch.values * batch.root_weights
    share = np.matmul(inverse_factor, np.matmul(functions, values[..., None]))
    coefficients = np.matmul(inverse_factor.swapaxes(-1, -2), share)[..., 0]
    residual = values - np.matmul(coefficients[..., None, :], functions)[..., 0, :]
    return Fit(support, coefficients, functions, inverse_factor, residual, tables)


def _chosen(dictionary: Dictionary, support: Indices, tables: Array) -> Array:
    """Values of the chosen functions, (B, D, s, N); zero where none was chosen."""
    count, observations = tables.shape[2:]
    first = count * np.arange(len(support))[:, None, None]
    i, j = np.moveaxis(dictionary.degrees[support], -1, 0)
    functions = tables[0].reshape(-1, observations).take(first + i, axis=0)
    functions *= tables[1].reshape(-1, observations).take(first + j, axis=0)
    if (support < 0).any():
        functions *= (support >= 0)[..., None]
    return functions

"""Choosing the few functions that a patch uses: pursuits on Gram matrices, many problems at once (eq. 2).

For each signal b and the functions' values A (n, N) at the observations they look for

    argmin_S min_c |b - sum_{j in S} c_j a_j|^2,  |S| <= s,

greedily.  They see A only through the Gram matrix G = A A^T and the correlations A b, so a step costs O(s n) whatever
the number of observations (Rubinstein, Zibulevsky, Elad 2008).

scikit-learn's `orthogonal_mp_gram` finds the same functions (see `reference_pursuit`), but one patch at a time: for 64
patches with 3 signals each, n = 120 and s = 15, it takes more than 15 times as long as `matching_pursuit`.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from ..arrays import Array, Booleans, Indices

RIDGE = 1e-12
INDEPENDENT = 1e-10
"""A function counts as independent of the chosen ones while this share of its squared norm is left."""
NEGLIGIBLE = 1e-6
"""Squared norms count as at least this share of the largest one, so that no function of pure rounding is chosen."""

ROUNDING = 1e-13
"""Assumed relative rounding error of sums of squares."""

ROUNDED_POINTS = 1e-12
"""Root mean square, in halves of a domain's width, up to which signals are the rounding of points."""


@dataclass
class _Selection:
    """Least squares on the functions chosen so far; P problems, s functions, n in the dictionary.

    Attributes
    ----------
    support
        Chosen functions, (P, s); -1 where none was left to choose.
    inverse
        Inverse Gram matrix of the chosen functions, (P, s, s).
    regression
        Coefficients of every dictionary function on the chosen ones, K^-1 G[S, :], (P, s, n).
    coefficients
        Least-squares coefficients, (P, s).
    remaining
        Squared norm of every function's part orthogonal to the chosen ones, (P, n).
    correlation
        Correlation of every function with the residual, (P, n).
    """

    support: Indices
    inverse: Array
    regression: Array
    coefficients: Array
    remaining: Array
    correlation: Array

    def put(self, which: Indices, other: _Selection) -> None:
        """Overwrite the problems `which` by those of `other`."""
        for item in fields(self):
            getattr(self, item.name)[which] = getattr(other, item.name)


def matching_pursuit(
    gram: Array, correlation: Array, sparsity: int, allowed: Booleans | None = None, worth: Array | None = None
) -> Indices:
    """Orthogonal matching pursuit: repeatedly take the function most parallel to the residual.

    With r the residual of the least-squares fit on the functions chosen so far, the next one is

        argmax_j |<a_j, r>| / |a_j|        (Pati, Rezaiifar, Krishnaprasad 1993).

    Parameters
    ----------
    gram
        Gram matrix of the dictionary on each patch, (B, n, n).
    correlation
        Correlation of the functions with each signal, (B, D, n).
    sparsity
        Number of functions to choose, s.
    allowed
        Functions that may be chosen, (B, n); all where None.
    worth
        By how much a function has to lower the squared residual, (B,); nothing where None.  The number k of functions
        then minimises |r_k|^2 + k worth (Mallows 1973; Foster, George 1994).

    Returns
    -------
    ndarray
        Chosen functions in the order of their choice, (B, D, s); -1 where the rest depends on those chosen, or is not
        worth it.

    See Also
    --------
    reference_pursuit : the same by scikit-learn.
    """
    norm = np.diagonal(gram, axis1=1, axis2=2)
    return _greedy(gram, correlation, sparsity, allowed, np.broadcast_to(norm[:, None], correlation.shape), worth)


def least_squares_pursuit(
    gram: Array,
    correlation: Array,
    sparsity: int,
    allowed: Booleans | None = None,
    replacements: int = 1,
    worth: Array | None = None,
) -> Indices:
    """Orthogonal least squares: repeatedly take the function that lowers the residual most, then exchange.

    With P the projection on the functions chosen so far and r the residual, the next one is

        argmin_j min_c |b - (chosen ones and a_j) c|^2 = argmax_j |<a_j, r>| / |a_j - P a_j|
        (Chen, Cowan, Grant 1991; Chen, Billings, Luo 1989).

    Then each chosen function in turn is replaced by the best one for its place.  If all functions up to some degree
    together fit better than that, they are taken instead: so a polynomial of low degree is reproduced over any domain,
    which choosing one function at a time cannot guarantee.

    Parameters
    ----------
    gram, correlation, sparsity, allowed, worth
        As in `matching_pursuit`.
    replacements
        Number of cyclic replacement passes.

    Returns
    -------
    ndarray
        Chosen functions, (B, D, s); -1 as in `matching_pursuit`.

    See Also
    --------
    matching_pursuit : the cheaper criterion; scikit-learn offers no orthogonal least squares.
    """
    support = _greedy(gram, correlation, sparsity, allowed, None, worth)
    for _ in range(replacements):
        support = _replace_cyclically(gram, correlation, support, allowed)
    better = _or_low_degrees(gram, correlation, support, allowed)
    # For noisy data fewer functions are better than the smallest residual.
    return better if worth is None else np.where((worth > 0.0)[:, None, None], support, better)


def reference_pursuit(
    gram: Array, correlation: Array, sparsity: int, allowed: Booleans | None = None, worth: Array | None = None
) -> Indices:
    """Orthogonal matching pursuit by scikit-learn, one signal at a time; parameters as in `matching_pursuit`.

    Returns
    -------
    ndarray
        Chosen functions in ascending order, (B, D, s); -1 where scikit-learn stopped earlier.

    See Also
    --------
    sklearn.linear_model.orthogonal_mp_gram
    """
    from sklearn.linear_model import orthogonal_mp_gram  # slow to load, and needed by this choice alone

    support = np.full((*correlation.shape[:2], sparsity), -1)
    price = np.zeros(len(gram)) if worth is None else worth
    for problem, own in enumerate(gram):
        norm = np.sqrt(np.diagonal(own))
        usable = np.flatnonzero((norm > 0.0) & (True if allowed is None else allowed[problem]))
        unit = own[np.ix_(usable, usable)] / (norm[usable, None] * norm[usable])
        for signal, parallel in enumerate(correlation[problem][:, usable] / norm[usable]):
            largest = np.abs(parallel).max(initial=0.0)
            if largest == 0.0:
                continue
            parallel /= largest  # it stops at an absolute threshold
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # it says when it stops early
                most = min(sparsity, len(usable))
                path = orthogonal_mp_gram(unit, parallel, n_nonzero_coefs=most, return_path=True)
            path = path.reshape(len(usable), -1)
            explained = parallel @ path - price[problem] / largest**2 * np.arange(1, path.shape[1] + 1)
            steps = explained.argmax() if price[problem] > 0.0 else -1
            chosen = usable[np.flatnonzero(path[:, steps])]
            support[problem, signal, : len(chosen)] = chosen
    return support


PURSUITS: dict[str, Callable[..., Indices]] = {
    "ols": least_squares_pursuit,
    "omp": matching_pursuit,
    "sklearn": reference_pursuit,
}
"""The pursuits by the names that the setting `pursuit` has for them."""


def _greedy(
    gram: Array,
    correlation: Array,
    sparsity: int,
    allowed: Booleans | None,
    fixed_norm: Array | None,
    worth: Array | None = None,
) -> Indices:
    """Forward selection: an orthogonalised row for each chosen function, as in a Gram-Schmidt process."""
    batch, signals, size = correlation.shape
    problems = batch * signals
    patch = np.repeat(np.arange(batch), signals)
    row = np.arange(problems)
    residual = correlation.reshape(problems, size).copy()
    norm = np.diagonal(gram, axis1=1, axis2=2)[patch]
    remaining = norm.copy()
    smallest = INDEPENDENT * np.maximum(norm, NEGLIGIBLE * norm.max(axis=1, keepdims=True))
    scale = remaining if fixed_norm is None else fixed_norm.reshape(problems, size)
    forbidden = np.zeros((problems, size), dtype=bool) if allowed is None else ~allowed[patch]
    rows = np.zeros((problems, sparsity, size))
    support = np.full((problems, sparsity), -1, dtype=np.int64)
    gain = np.zeros((problems, sparsity))
    for k in range(sparsity):
        usable = (remaining > smallest) & ~forbidden
        score = np.divide(residual**2, scale, out=np.full_like(residual, -1.0), where=usable)
        best = score.argmax(axis=1)
        found = usable[row, best]
        new = gram[patch, best]
        if k:
            new = new - np.matmul(rows[row, :k, best][:, None, :], rows[:, :k])[:, 0]
        pivot = np.where(found, remaining[row, best], 1.0)
        new *= (found / np.sqrt(pivot))[:, None]
        step = np.where(found, residual[row, best], 0.0) / np.sqrt(pivot)
        rows[:, k] = new
        residual -= step[:, None] * new
        remaining -= new**2
        forbidden[row, best] = True
        support[:, k] = np.where(found, best, -1)
        gain[:, k] = step**2
    if worth is not None:
        count = np.cumsum(gain - worth[patch, None], axis=1).argmax(axis=1) + 1
        support[(np.arange(sparsity) >= count[:, None]) & (worth[patch, None] > 0.0)] = -1
    return support.reshape(batch, signals, sparsity)


def _replace_cyclically(gram: Array, correlation: Array, support: Indices, allowed: Booleans | None) -> Indices:
    """Replace each chosen function in turn by the best one for its place, which may be itself."""
    batch, signals, sparsity = support.shape
    size = gram.shape[-1]
    patch = np.repeat(np.arange(batch), signals)
    complete = (support >= 0).all(axis=-1).reshape(-1)
    active = np.flatnonzero(complete)
    if not len(active):
        return support
    patch = patch[active]
    signal = correlation.reshape(-1, size)[active]
    chosen = _regress(gram, signal, support.reshape(-1, sparsity)[active], patch)
    barred = np.zeros((len(active), size), dtype=bool) if allowed is None else ~allowed[patch]
    norm = np.diagonal(gram, axis1=1, axis2=2)[patch]
    norm = np.maximum(norm, NEGLIGIBLE * norm.max(axis=1, keepdims=True))
    for position in range(sparsity):
        better, entering = _best_exchange(chosen, position, barred, norm)
        if len(better):
            exchanged = chosen.support[better]
            exchanged[:, position] = entering
            chosen.put(better, _regress(gram, signal[better], exchanged, patch[better]))
    result = support.reshape(-1, sparsity).copy()
    result[active] = chosen.support
    return result.reshape(support.shape)


def _or_low_degrees(gram: Array, correlation: Array, support: Indices, allowed: Booleans | None) -> Indices:
    """Take all functions up to the highest total degree that has room, where they fit no worse than the chosen ones.

    A lower degree is tried where these depend on each other, as on a narrow strip.

    Where both leave only rounding errors, those of low degree do not oscillate between the observations.
    """
    sparsity, size = support.shape[-1], correlation.shape[-1]
    highest = int((np.sqrt(8 * min(sparsity, size) + 1) - 3) / 2)
    present, _ = _explained(gram, correlation, support)
    rounded = ROUNDED_POINTS**2 * gram[:, :1, 0]  # the first function is one everywhere
    undecided = np.ones(present.shape, dtype=bool)
    for degree in range(highest, -1, -1):
        leading = np.arange((degree + 1) * (degree + 2) // 2)
        low = np.full_like(support, -1)
        low[..., : len(leading)] = leading
        if allowed is not None:
            places = low[..., : len(leading)]
            places[~np.broadcast_to(allowed[:, None, leading], places.shape)] = -1
        possible, independent = _explained(gram, correlation, low)
        better = undecided & independent & (possible >= present * (1.0 - ROUNDING) - rounded)
        support = np.where(better[..., None], low, support)
        undecided &= ~better
    return support


def _explained(gram: Array, correlation: Array, support: Indices) -> tuple[Array, Booleans]:
    """Squared length of the signals' projections on the chosen functions, (B, D), and whether these are independent."""
    some = support >= 0
    patch = np.arange(len(gram))[:, None, None, None]
    among = gram[patch, support[..., :, None], support[..., None, :]] * (some[..., :, None] & some[..., None, :])
    norm = np.sqrt(np.diagonal(among, axis1=-2, axis2=-1))
    inverse_norm = np.divide(1.0, norm, out=np.zeros_like(norm), where=norm > 0.0)
    among *= inverse_norm[..., :, None] * inverse_norm[..., None, :]
    diagonal = np.arange(support.shape[-1])
    among[..., diagonal, diagonal] = 1.0 + RIDGE
    factor = np.linalg.cholesky(among)
    own = np.take_along_axis(correlation, support, axis=-1) * inverse_norm
    explained: Array = (np.linalg.solve(factor, own[..., None])[..., 0] ** 2).sum(axis=-1)
    smallest_pivot: Array = (factor[..., diagonal, diagonal] ** 2).min(axis=-1)
    return explained, smallest_pivot > INDEPENDENT


def _regress(gram: Array, correlation: Array, support: Indices, patch: Indices) -> _Selection:
    """Least squares of the signals and of all functions on the chosen ones."""
    rows = gram[patch[:, None], support]
    among = np.take_along_axis(rows, support[:, None, :], axis=2)
    # so that functions which depend on each other up to rounding do not make the matrix singular
    diagonal = np.arange(support.shape[1])
    among[:, diagonal, diagonal] *= 1.0 + RIDGE
    inverse = np.asarray(np.linalg.inv(among), dtype=np.float64)
    regression = np.matmul(inverse, rows)
    own = np.take_along_axis(correlation, support, axis=1)
    coefficients = np.matmul(inverse, own[..., None])[..., 0]
    remaining = np.diagonal(gram, axis1=1, axis2=2)[patch] - (rows * regression).sum(axis=1)
    left_over = correlation - np.matmul(coefficients[:, None, :], rows)[:, 0]
    return _Selection(support.copy(), inverse, regression, coefficients, remaining, left_over)


def _best_exchange(chosen: _Selection, position: int, barred: Booleans, norm: Array) -> tuple[Indices, Indices]:
    """Problems in which another function does better at `position`, and that function."""
    pivot = chosen.inverse[:, position, position][:, None]
    regression = chosen.regression[:, position]
    weight = chosen.coefficients[:, position][:, None] / pivot
    # correlations and norms as they are once the function is taken out
    correlation = chosen.correlation + weight * regression
    remaining = chosen.remaining + regression**2 / pivot
    usable = (remaining > INDEPENDENT * norm) & ~barred
    np.put_along_axis(usable, chosen.support, False, axis=1)
    gain = np.divide(correlation**2, remaining, out=np.full_like(remaining, -1.0), where=usable)
    entering = gain.argmax(axis=1)
    present = (chosen.coefficients[:, position][:, None] * weight)[:, 0]
    better = np.flatnonzero(gain[np.arange(len(gain)), entering] > present * (1 + 1e-9))
    return better, entering[better]

"""The default patch solver: Gauss-Newton on the domain with the coefficients eliminated (eq. 3, minimised another way).

For a given domain U and support S the best coefficients follow from linear least squares; putting them in leaves the
variable projection functional r_d(U) = (I - A_d A_d^+) b_d (Golub, Pereyra 1973).  Kaufman's approximation (1975) of
its Jacobian, -(I - A_d A_d^+) G_d W with G_d the gradients of the fitted function at the observations, gives a
Gauss-Newton system that conjugate gradients solve without ever forming it.  The regularisation is annealed over the
first steps: it shapes the way to the minimum and then gets out of its way.  From then on every problem goes on by
itself until a step gains it little.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..batch import Batch
from ..cross_validation import validated_sparsity
from ..dictionary import Dictionary, coefficient_grid
from ..domain_energy import determinant, largest_step
from ..pursuit import least_squares_pursuit, matching_pursuit
from ..solution import Solution, Trace
from .gauss_newton import gauss_newton_move

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

ANNEALING_STEPS = 8
PROXIMITY_DECAY = 0.26
RIGIDITY_DECAY = 0.37
"""Factors of beta1 and beta2 from one of the annealing steps to the next."""
RESELECT_AT = (0, 2)
"""Annealing steps before which the functions are chosen anew."""
SETTLED = 0.05
"""Share of its energy that a step has to gain a problem, once the regularisation is annealed, for it to go on."""
WORTH_MAKING_SMALLER = 0.7
"""Share of a batch's problems below which those that still move are put into a batch of their own."""

DETERMINANT_FLOOR = 0.02
STEP_SHARE = 0.8
FARTHEST = 100.0
"""Domains begin within [-1, 1]; one that wants to go so far has no surface to follow (a patch of identical points)."""
RIDGE = 1e-11
NEGLIGIBLE = 1e-8
"""Length of a function, compared with the longest one chosen, below which it takes no part."""


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
        """Overwrite the problems `which` by `theirs` of `other`, which have the same support."""
        for name in _CHANGING:
            getattr(self, name)[which] = getattr(other, name)[theirs]
        self.tables[:, which] = other.tables[:, theirs]


_CHANGING = ("coefficients", "functions", "inverse_factor", "residual")
"""What changes of a fit when its domain does, problem by problem; and so do the tables."""


@dataclass
class State:
    """Where the solver stands: domains, supports and what they give.

    Attributes
    ----------
    domain
        (2, B, m), in the problems' frames.
    fit
        Least squares over that domain.
    damping
        Levenberg-Marquardt damping, (B,).
    settled
        Whether the last step gained a problem little, (B,).
    """

    domain: Array
    fit: Fit
    damping: Array
    settled: NDArray[np.bool_]

    @classmethod
    def at(cls, domain: Array, fit: Fit) -> State:
        """Start there, without damping."""
        problems = domain.shape[1]
        return cls(domain, fit, np.zeros(problems), np.zeros(problems, dtype=bool))

    def only(self, which: Indices) -> State:
        """Some of the problems."""
        return State(self.domain[:, which], self.fit.only(which), self.damping[which], self.settled[which])

    def put(self, which: Indices, other: State) -> None:
        """Overwrite the problems `which` by all those of `other`, in that order."""
        self.domain[:, which] = other.domain
        self.fit.put(which, other.fit, np.arange(len(which)))
        self.damping[which], self.settled[which] = other.damping, other.settled


def solve(
    batch: Batch,
    dictionary: Dictionary,
    *,
    sparsity: int,
    iterations: int,
    beta1: float,
    beta2: float,
    pursuit: str = "ols",
    automatic_sparsity: bool = False,
    keep_values: bool = False,
) -> Solution:
    """Minimise eq. 3 for every problem of the batch.

    Each problem has its own damping, step length and acceptance; a problem whose energy would rise keeps its state.

    Parameters
    ----------
    batch
        Padded problems.
    dictionary
        Basis functions.
    sparsity
        Functions that each signal may use, s.
    iterations
        Gauss-Newton steps at most.
    beta1, beta2
        Weights of eq. 4 at the first iteration; they decay geometrically.
    pursuit
        "ols" or "omp".
    automatic_sparsity
        Choose each signal's number of functions, up to `sparsity`, by cross-validation.
    keep_values
        Whether the trace keeps the values of every iteration.

    Returns
    -------
    Solution
    """
    choose = select_validated if automatic_sparsity else select
    state = State.at(batch.start.copy(), choose(batch, dictionary, batch.start, sparsity, pursuit))
    trace = Trace(keep_values)
    if iterations == 0:
        _note(trace, batch, dictionary, state, state.fit.misfit)
    for iteration in range(min(iterations, ANNEALING_STEPS)):
        if iteration and iteration in RESELECT_AT:
            anew = choose(batch, dictionary, state.domain, sparsity, pursuit)
            state.fit = merge(_generalises(batch, anew) < _generalises(batch, state.fit), anew, state.fit)
        weights = annealed_weights(iteration, beta1, beta2)
        _note(trace, batch, dictionary, state, step(batch, dictionary, state, weights))
    _settle(batch, dictionary, state, iterations - ANNEALING_STEPS, final_weights(iterations, beta1, beta2), trace)
    trace.hold(iterations)
    return _solution(state, trace)


def improve(
    batch: Batch,
    dictionary: Dictionary,
    domain: Array,
    support: Indices,
    *,
    iterations: int,
    weights: tuple[float, float],
) -> Solution:
    """Go on from an earlier solution with its functions held and the regularisation fixed.

    Parameters
    ----------
    domain
        Where to start, (2, B, m).
    support
        Functions of each signal, (B, D, s).
    iterations
        Gauss-Newton steps.
    weights
        beta1 and beta2 of eq. 4.
    """
    state = State.at(domain, least_squares(batch, dictionary, domain, support))
    for _ in range(iterations):
        step(batch, dictionary, state, weights)
    return _solution(state, Trace())


def _settle(
    batch: Batch, dictionary: Dictionary, state: State, steps: int, weights: tuple[float, float], trace: Trace
) -> None:
    """Go on with functions and weights held; each problem ends when a step gains it little.  Updates `state`."""
    which, moving, part = np.arange(batch.problems), batch, state
    for _ in range(steps):
        going_on = np.flatnonzero(~part.settled)
        if len(going_on) <= WORTH_MAKING_SMALLER * len(which):
            state.put(which, part)
            which, moving, part = which[going_on], moving.only(going_on), part.only(going_on)
        if not len(which):
            return
        energy = step(moving, dictionary, part, weights)
        _note(trace, moving, dictionary, part, energy, which)
    state.put(which, part)


def _note(
    trace: Trace, batch: Batch, dictionary: Dictionary, state: State, energy: Array, which: Indices | None = None
) -> None:
    fit = state.fit
    trace.note(
        batch,
        energy,
        fit.residual,
        lambda: dictionary.sparse_values(fit.support, fit.coefficients, state.domain[:, :, None]),
        which,
    )


def _solution(state: State, trace: Trace) -> Solution:
    return Solution(state.domain, state.fit.support, refined_coefficients(state.fit), trace)


def refined_coefficients(fit: Fit) -> Array:
    """The coefficients after one step of iterative refinement, (B, D, s): it takes back what the ridge cost."""
    share = np.matmul(fit.inverse_factor, np.matmul(fit.functions, fit.residual[..., None]))
    refined: Array = fit.coefficients + np.matmul(fit.inverse_factor.swapaxes(-1, -2), share)[..., 0]
    return refined


def annealed_weights(iteration: int, beta1: float, beta2: float) -> tuple[float, float]:
    """beta1 and beta2 at an iteration, counted from 0."""
    step = min(iteration, ANNEALING_STEPS - 1)
    return beta1 * PROXIMITY_DECAY**step, beta2 * RIGIDITY_DECAY**step


def final_weights(iterations: int, beta1: float, beta2: float) -> tuple[float, float]:
    """beta1 and beta2 at the last of the iterations."""
    return annealed_weights(max(iterations - 1, 0), beta1, beta2)


def select(batch: Batch, dictionary: Dictionary, domain: Array, sparsity: int, pursuit: str) -> Fit:
    """Choose the functions for the given domains and fit them."""
    gram, correlation = _normal_equations(batch, dictionary, domain)
    allowed = _allowed(batch, dictionary)
    pursue = least_squares_pursuit if pursuit == "ols" else matching_pursuit
    # the largest gain that the best of so many functions has on noise alone
    worth = 2.0 * np.log(np.maximum(allowed.sum(axis=1), 2)) * batch.noise
    support = pursue(gram, correlation, _most(batch, allowed, sparsity), allowed, worth=worth)
    return least_squares(batch, dictionary, domain, support)


def select_validated(batch: Batch, dictionary: Dictionary, domain: Array, sparsity: int, pursuit: str) -> Fit:
    """Choose the functions, and how many of them each signal needs, by cross-validation."""
    allowed = _allowed(batch, dictionary)
    most = _most(batch, allowed, sparsity)
    weighted = dictionary.evaluate(batch.observed(domain)) * batch.root_weights
    wanted = validated_sparsity(weighted, batch.values * batch.root_weights, most, allowed)
    gram, correlation = _normal_equations(batch, dictionary, domain)
    support = np.full((*wanted.shape, most), -1, dtype=np.int64)
    pursue = least_squares_pursuit if pursuit == "ols" else matching_pursuit
    for count in np.unique(wanted):
        problem, signal = np.nonzero(wanted == count)
        chosen = pursue(gram[problem], correlation[problem, signal][:, None], int(count), allowed[problem])
        support[problem, signal, :count] = chosen[:, 0]
    return least_squares(batch, dictionary, domain, support)


def _normal_equations(batch: Batch, dictionary: Dictionary, domain: Array) -> tuple[Array, Array]:
    """Gram matrices of the weighted dictionary (B, n, n), and its correlations with the weighted signals (B, D, n).

    One problem at a time: the values of the whole dictionary at its observations just fit into a processor's cache.
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


def _allowed(batch: Batch, dictionary: Dictionary) -> NDArray[np.bool_]:
    """Functions that each problem may use, (B, n)."""
    return dictionary.degrees.sum(axis=1) <= batch.degrees[:, None]


def _most(batch: Batch, allowed: NDArray[np.bool_], sparsity: int) -> int:
    """How many functions a signal can use: no more than there are observations, beyond which all depend on others."""
    return min(sparsity, int(allowed.sum(axis=1).max()), batch.values.shape[-1])


def _generalises(batch: Batch, fit: Fit) -> Array:
    """Generalised cross-validation score of each problem, (B,): the misfit, dearer the more functions it takes.

    With equally many functions the order is that of the misfit (Golub, Heath, Wahba 1979).
    """
    observations = (batch.root_weights[:, 0] > 0.0).sum(axis=1) * fit.residual.shape[1]
    functions = (fit.support >= 0).sum(axis=(1, 2))
    score: Array = fit.misfit / np.maximum(observations - functions, 1) ** 2
    return score


def as_wide_as(fit: Fit, support: Indices) -> Indices:
    """Chosen functions (B, D, any) with as many places as those of `fit`.

    Patches may have been fitted beside others that can use more functions, or fewer; the places that are cut off or
    added name none.
    """
    wide = np.full_like(fit.support, -1)
    width = min(wide.shape[-1], support.shape[-1])
    wide[..., :width] = support[..., :width]
    return wide


def merge(first: NDArray[np.bool_], one: Fit, other: Fit) -> Fit:
    """Problems of `one` where `first` holds, of `other` elsewhere."""
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
    """Fit given functions over given domains: Cholesky factor of the column-scaled Gram matrix."""
    tables = _weighted_tables(batch, dictionary, domain)
    functions = _chosen(dictionary, support, tables)
    gram = np.matmul(functions, functions.swapaxes(-1, -2))
    norm = np.sqrt(np.diagonal(gram, axis1=-2, axis2=-1))
    # What a function has left after weights changed may be nothing: it must not get a huge coefficient for that.
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


def step(batch: Batch, dictionary: Dictionary, state: State, weights: tuple[float, float]) -> Array:
    """One damped Gauss-Newton step of every problem; returns the energies (B,) and updates `state`."""
    energy, fit = batch.energy, state.fit
    flat = state.domain.reshape(2, -1)
    jacobian = energy.jacobian(flat)
    before = fit.misfit + regularisation(batch, flat, jacobian, weights)
    gradient = function_gradient(batch, dictionary, fit)
    force = downhill(batch, state, gradient, jacobian, weights).reshape(state.domain.shape)
    move = gauss_newton_move(batch, fit.orthonormal, gradient, weights, state.damping, force)
    change = energy.jacobian(move)
    limit = batch.by_problem(largest_step(jacobian, change, DETERMINANT_FLOOR)).min(axis=1)
    length = np.minimum(1.0, STEP_SHARE * limit)[:, None]
    tried = state.domain + length * move
    jacobian = jacobian + (length * batch.by_problem(change)).reshape(change.shape)
    new = least_squares(batch, dictionary, tried, fit.support)
    after = new.misfit + regularisation(batch, tried.reshape(2, -1), jacobian, weights)
    # written so that what overflowed counts as worse, too
    worse = np.flatnonzero(~((after < before) & (np.abs(tried).max(axis=(0, 2)) < FARTHEST)))
    tried[:, worse] = state.domain[:, worse]
    new.put(worse, fit, worse)
    after[worse] = before[worse]
    state.damping[worse] = np.maximum(state.damping[worse], 1e-3) * (8.0 / 0.3)
    state.damping *= 0.3
    state.domain, state.fit, state.settled = tried, new, ~(after < (1.0 - SETTLED) * before)
    return after


def downhill(batch: Batch, state: State, gradient: Array, jacobian: Array, weights: tuple[float, float]) -> Array:
    """Minus half the gradient of the objective with respect to the domains, (2, B m).

    Exact: with the coefficients at their optimum, moving a domain changes the misfit only through the fitted functions.

    Parameters
    ----------
    gradient
        Weighted gradients of the fitted functions, (2, B, D, N).
    jacobian
        Of the domain transformations, (2, 2, T).
    weights
        beta1 and beta2 of eq. 4.
    """
    flat = state.domain.reshape(2, -1)
    force = batch.collected(np.einsum("cbdn,bdn->cbn", gradient, state.fit.residual)).reshape(2, -1)
    force -= weights[0] * (flat - batch.energy.start) + 0.5 * weights[1] * batch.energy.rigidity_gradient(jacobian)
    return force


def regularisation(batch: Batch, flat: Array, jacobian: Array, weights: tuple[float, float]) -> Array:
    """Q(U) of every problem, (B,)."""
    proximity = batch.by_problem(batch.energy.proximity(flat)).sum(axis=1)
    rigidity = batch.by_problem(batch.energy.rigidity(jacobian)).sum(axis=1)
    total: Array = weights[0] * proximity + weights[1] * rigidity
    return total


def function_gradient(batch: Batch, dictionary: Dictionary, fit: Fit) -> Array:
    """Weighted gradients of the fitted functions at the observations, (2, B, D, N)."""
    grid = coefficient_grid(dictionary.degrees, fit.support, fit.coefficients, dictionary.degree)
    slope = dictionary.derivative_matrix
    along = np.stack([np.matmul(slope.T, grid), np.matmul(grid, slope)], axis=1)
    u_table, v_table = fit.tables
    across = np.matmul(along.reshape(batch.problems, -1, v_table.shape[1]), v_table)
    return np.einsum("bcdin,bin->cbdn", across.reshape(*along.shape[:-1], -1), u_table)


def smallest_determinant(batch: Batch, domain: Array) -> Array:
    """Smallest determinant of each problem's domain transformation, (B,); padding counts as one."""
    value = determinant(batch.energy.jacobian(domain.reshape(2, -1)))
    value[batch.energy.area == 0.0] = 1.0
    return batch.by_problem(value).min(axis=1)

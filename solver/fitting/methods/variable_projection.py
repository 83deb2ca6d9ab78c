"""The default method: Gauss-Newton on the domain with the coefficients eliminated.

It minimises the objective of eq. 3 (with Q of eq. 4) for each problem,

    E(U) = sum_d |r_d(U)|^2 + beta1 |U - U0|^2 + beta2 sum_t A_t ((s1 - 1)^2 + (s2 - 1)^2),
    r_d(U) = (I - A_d A_d^+) b_d,

where the best coefficients for a domain U and the chosen functions A_d have been put in: r_d is the variable projection
functional (Golub, Pereyra 1973).  Kaufman's approximation (1975) of its Jacobian, -(I - A_d A_d^+) G_d W with G_d the
gradients of the fitted function at the observations, gives a Gauss-Newton system that conjugate gradients solve
matrix-free.  The first steps anneal the regularisation: it guides the way to a minimum, then its influence fades.  From
then on each problem continues until a step gains little.

A side of a crease is smooth: where its fit is good the domain has nothing more to do.  Such a problem ends at the first
annealing step that gains it little.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Booleans, Indices
from ...settings import Settings
from ..batch import Batch
from ..dictionary import Dictionary, coefficient_grid
from ..domain_energy import largest_step
from ..solution import Solution, Trace
from ..sparse_fit import Fit, generalisation_score, least_squares, merge, refined_coefficients, select, select_validated
from .gauss_newton import gauss_newton_move

ANNEALING_STEPS = 8
PROXIMITY_DECAY = 0.26
RIGIDITY_DECAY = 0.37
"""Factors of beta1 and beta2 from one of the annealing steps to the next."""
SEPARATE_RIGIDITY_DECAY = 0.25
"""The same of beta2 with a domain for each coordinate: what these follow on a mesh is fair."""
RESELECT_AT = (0, 2)
"""Annealing steps before which the functions are chosen again."""
SETTLED = 0.05
"""A problem stops after annealing once a step lowers its energy by less than this share."""
WORTH_MAKING_SMALLER = 0.7
"""Share of a batch's problems below which those that still move get a batch of their own."""

EARLY_GAIN = 0.4
"""A problem that may end early does at the first annealing step that lowers its misfit by less than this share, ..."""
EARLY_MISFIT = 1.5e-3
"""... if its root mean square misfit is below this, in halves of the domain's width."""
EXACT_MISFIT = 1e-8
"""It ends whatever it gains when the misfit is below this."""

DETERMINANT_FLOOR = 0.02
"""Smallest determinant of the domain transformation on any triangle."""
STEP_SHARE = 0.8
"""Largest share of the way to that determinant that one step takes."""
FARTHEST = 100.0
"""Domains start within [-1, 1]; one that moves this far has no surface to follow (a patch of identical points)."""


@dataclass
class State:
    """The solver's state: domains and the fit over them.

    Attributes
    ----------
    domain
        (2, B, m), in the problems' frames.
    fit
        Least squares over that domain.
    damping
        Levenberg-Marquardt damping, (B,).
    settled
        Whether the last step gained little, (B,).
    """

    domain: Array
    fit: Fit
    damping: Array
    settled: Booleans

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


def solve(batch: Batch, dictionary: Dictionary, settings: Settings) -> Solution:
    """Minimise eq. 3 for every problem of the batch, with weights of Q that decay over the first steps.

    Each problem has its own damping, step length and acceptance; one whose energy would rise keeps its state.

    Parameters
    ----------
    batch
        Padded problems.
    dictionary
        Basis functions.
    settings
        `sparsity`, `automatic_sparsity`, `pursuit`, `iterations` (Gauss-Newton steps at most), `beta1` and `beta2`
        (at the first of them) and `keep_iterations`.
    """
    choose = select_validated if settings.automatic_sparsity else select
    how, iterations = (settings.sparsity, settings.pursuit), settings.iterations
    state = State.at(batch.start.copy(), choose(batch, dictionary, batch.start, *how))
    trace = Trace(settings.keep_iterations)
    if iterations == 0:
        _note(trace, batch, dictionary, state, state.fit.misfit)
    energy = state.fit.misfit
    ended = _ends_early(batch, energy, np.full(batch.problems, np.inf))
    for iteration in range(min(iterations, ANNEALING_STEPS)):
        if iteration and iteration in RESELECT_AT:
            new = choose(batch, dictionary, state.domain, *how)
            better = generalisation_score(batch, new) < generalisation_score(batch, state.fit)
            state.fit = merge(better & ~ended, new, state.fit)
        before, held, last = state.fit.misfit, np.flatnonzero(ended), energy
        kept = state.only(held)
        energy = step(batch, dictionary, state, annealed_weights(settings, iteration))
        state.put(held, kept)
        energy[held] = last[held]
        _note(trace, batch, dictionary, state, energy)
        ended |= _ends_early(batch, state.fit.misfit, before)
    state.settled |= ended
    _settle(batch, dictionary, state, iterations - ANNEALING_STEPS, final_weights(settings), trace)
    trace.hold(iterations)
    return _solution(state, trace)


def _ends_early(batch: Batch, misfit: Array, before: Array) -> Booleans:
    """Which problems end, (B,), for their misfits after and before an annealing step."""
    weight = (batch.root_weights[:, 0] ** 2).sum(axis=1)
    little = (misfit > (1.0 - EARLY_GAIN) * before) & (misfit < EARLY_MISFIT**2 * weight)
    ends: Booleans = batch.end_early & (little | (misfit < EXACT_MISFIT**2 * weight))
    return ends


def improve(
    batch: Batch, dictionary: Dictionary, settings: Settings, domain: Array, support: Indices, iterations: int
) -> Solution:
    """Continue from an earlier solution with its functions held and the regularisation fixed at its final weights.

    Parameters
    ----------
    batch, dictionary, settings
        As in `solve`.
    domain
        Where to start, (2, B, m).
    support
        Functions of each signal, (B, D, s).
    iterations
        Gauss-Newton steps.
    """
    state, weights = State.at(domain, least_squares(batch, dictionary, domain, support)), final_weights(settings)
    for _ in range(iterations):
        step(batch, dictionary, state, weights)
    return _solution(state, Trace())


def _settle(
    batch: Batch, dictionary: Dictionary, state: State, steps: int, weights: tuple[float, float], trace: Trace
) -> None:
    """Continue with functions and weights held until each problem has settled.  Updates `state`."""
    which, moving, part = np.arange(batch.problems), batch, state
    for _ in range(steps):
        unsettled = np.flatnonzero(~part.settled)
        if len(unsettled) <= WORTH_MAKING_SMALLER * len(which):
            state.put(which, part)
            which, moving, part = which[unsettled], moving.only(unsettled), part.only(unsettled)
        if not len(which):
            return
        energy = step(moving, dictionary, part, weights)
        _note(trace, moving, dictionary, part, energy, which)
    state.put(which, part)


def _note(
    trace: Trace, batch: Batch, dictionary: Dictionary, state: State, energy: Array, which: Indices | None = None
) -> None:
    fit = state.fit
    trace.note(batch, energy, fit.residual, dictionary, fit.support, fit.coefficients, state.domain, which)


def _solution(state: State, trace: Trace) -> Solution:
    return Solution(state.domain, state.fit.support, refined_coefficients(state.fit), trace)


def annealed_weights(settings: Settings, iteration: int) -> tuple[float, float]:
    """beta1 and beta2 at an iteration, counted from 0."""
    step = min(iteration, ANNEALING_STEPS - 1)
    return settings.beta1 * PROXIMITY_DECAY**step, settings.beta2 * rigidity_decay(settings) ** step


def rigidity_decay(settings: Settings) -> float:
    """Factor of beta2 from one annealing step to the next."""
    return SEPARATE_RIGIDITY_DECAY if settings.domains == "separate" else RIGIDITY_DECAY


def final_weights(settings: Settings) -> tuple[float, float]:
    """beta1 and beta2 at the last iteration."""
    return annealed_weights(settings, max(settings.iterations - 1, 0))


def iterations_down_to(settings: Settings, lowest: float) -> int:
    """Number of iterations after which beta1 would decay below `lowest`; all of them if it never does."""
    if lowest >= settings.beta1:
        return min(1, settings.iterations)
    count = int(np.log(lowest / settings.beta1) / np.log(PROXIMITY_DECAY)) + 1
    return min(count, settings.iterations) if count <= ANNEALING_STEPS else settings.iterations


def step(batch: Batch, dictionary: Dictionary, state: State, weights: tuple[float, float]) -> Array:
    """Take one damped Gauss-Newton step of every problem; return the energies (B,) and update `state`."""
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
    # written so that overflows count as worse
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

    It is exact: at the optimal coefficients, moving a domain changes the misfit only through the fitted functions.

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

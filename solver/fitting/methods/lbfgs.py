"""Minimising many small smooth functions at once: limited-memory BFGS with an analytic gradient.

The problems go forward together, each with its own curvature pairs, step length and end, so that every evaluation is
one set of array operations however many there are.

Sources: Nocedal 1980 (two-loop recursion); Nocedal, Wright, Numerical Optimization, chapters 3 and 7.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from ...arrays import Array, Booleans

Objective = Callable[[Array], tuple[Array, Array]]

MEMORY = 12
SUFFICIENT_DECREASE = 1e-4
SHORTENINGS = 12
LEAST_CURVATURE = 1e-10


def minimise(objective: Objective, start: Array, *, steps: int, tolerance: float) -> Array:
    """Minimise B functions of n variables each.

    Parameters
    ----------
    objective
        Maps points (B, n) to values (B,) and gradients (B, n); problem b depends on row b alone.
    start
        Where to begin, (B, n).
    steps
        Largest number of steps.
    tolerance
        A problem ends when a step lowers it by less than this share of its value.

    Returns
    -------
    ndarray
        Points, (B, n), in which no function is larger than at its start.
    """
    point = start.copy()
    value, gradient = objective(point)
    active = np.ones(len(point), dtype=bool)
    pairs = _CurvaturePairs(len(point))
    for number in range(steps):
        direction = -pairs.inverse_hessian_times(gradient)
        slope = _dot(direction, gradient)
        uphill = slope >= 0.0
        if uphill.any():
            pairs.forget(uphill)
            direction[uphill] = -gradient[uphill]
            slope = _dot(direction, gradient)
        length = np.ones(len(point))
        if number == 0:
            length /= np.maximum(1.0, np.sqrt(-slope))
        found, new_point, new_value, new_gradient = _line_search(
            objective, point, value, gradient, direction, slope, length, active
        )
        pairs.add(new_point - point, new_gradient - gradient)
        active = found & (value - new_value > tolerance * np.abs(value))
        point, value, gradient = new_point, new_value, new_gradient
        if not active.any():
            break
    return point


class _CurvaturePairs:
    """The last steps and changes of gradient, from which the inverse Hessian is known."""

    def __init__(self, problems: int) -> None:
        self._pairs: deque[tuple[Array, Array, Array]] = deque(maxlen=MEMORY)
        self._scale = np.ones(problems)

    def add(self, move: Array, change: Array) -> None:
        """Take in a step; problems that did not move, or saw no positive curvature, learn nothing from it."""
        curvature, square = _dot(move, change), _dot(change, change)
        usable = curvature > LEAST_CURVATURE * np.sqrt(_dot(move, move) * square)
        self._pairs.append((move, change, np.divide(1.0, curvature, out=np.zeros_like(curvature), where=usable)))
        self._scale = np.divide(curvature, square, out=self._scale, where=usable)

    def forget(self, problems: Booleans) -> None:
        """Drop what is known of some problems."""
        for _, _, inverse in self._pairs:
            inverse[problems] = 0.0

    def inverse_hessian_times(self, gradient: Array) -> Array:
        """Two-loop recursion, (B, n)."""
        result = gradient.copy()
        shares = []
        for move, change, inverse in reversed(self._pairs):
            share = inverse * _dot(move, result)
            result -= share[:, None] * change
            shares.append(share)
        result *= self._scale[:, None]
        for (move, change, inverse), share in zip(self._pairs, reversed(shares), strict=True):
            result += (share - inverse * _dot(change, result))[:, None] * move
        return result


def _line_search(
    objective: Objective,
    point: Array,
    value: Array,
    gradient: Array,
    direction: Array,
    slope: Array,
    length: Array,
    active: Booleans,
) -> tuple[Booleans, Array, Array, Array]:
    """Shorten each active problem's step until it pays (Armijo); returns which did, and the points reached."""
    new_point, new_value, new_gradient = point.copy(), value.copy(), gradient.copy()
    waiting = active.copy()
    for _ in range(SHORTENINGS):
        trial = np.where(waiting[:, None], point + length[:, None] * direction, new_point)
        with np.errstate(over="ignore", invalid="ignore"):  # a step that is far too long
            trial_value, trial_gradient = objective(trial)
        pays = waiting & (trial_value <= value + SUFFICIENT_DECREASE * length * slope)
        new_point[pays], new_value[pays], new_gradient[pays] = trial[pays], trial_value[pays], trial_gradient[pays]
        waiting &= ~pays
        if not waiting.any():
            break
        # minimum of the parabola through what is known, kept within a tenth and a half of the step
        bend = 2.0 * (trial_value - value - length * slope)
        lowest = np.divide(-slope * length**2, bend, out=0.5 * length, where=np.isfinite(bend) & (bend > 0.0))
        length = np.where(waiting, np.clip(lowest, 0.1 * length, 0.5 * length), length)
    return active & ~waiting, new_point, new_value, new_gradient


def _dot(one: Array, other: Array) -> Array:
    product: Array = np.einsum("bn,bn->b", one, other)
    return product

"""Automatic sparsity against explicit loops and scikit-learn's least squares."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression
from sparse_surface.solver.fitting.cross_validation import FOLDS, validated_sparsity
from sparse_surface.solver.fitting.dictionary import Dictionary
from sparse_surface.solver.fitting.pursuit import least_squares_pursuit

MOST = 10


def noisy_signals(seed=0, observations=200):
    rng = np.random.default_rng(seed)
    domain = rng.uniform(-1.0, 1.0, (2, 2, observations))
    functions = Dictionary(6, "legendre").evaluate(domain)
    values = np.stack([functions[:, [1, 4, 9]].sum(axis=1), functions[:, 2]], axis=1)
    return functions, values + 0.05 * rng.normal(size=values.shape), np.ones(functions.shape[:2], dtype=bool)


def by_hand(functions, values, allowed):
    error = np.zeros(MOST)
    number = np.arange(functions.shape[1])
    for fold in range(FOLDS):
        known, held = number % FOLDS != fold, number % FOLDS == fold
        gram = functions[:, known] @ functions[:, known].T
        correlation = functions[:, known] @ values[known]
        support = least_squares_pursuit(gram[None], correlation[None, None], MOST, allowed[None], replacements=0)[0, 0]
        for count in range(MOST):
            rows = functions[[number for number in support[: count + 1] if number >= 0]]
            model = LinearRegression(fit_intercept=False).fit(rows[:, known].T, values[known])
            error[count] += ((model.predict(rows[:, held].T) - values[held]) ** 2).sum()
    return error.argmin() + 1


@pytest.mark.parametrize("observations", [50, 200])
def test_the_choice_is_that_of_explicit_cross_validation(observations):
    functions, values, allowed = noisy_signals(observations=observations)
    found = validated_sparsity(functions, values, MOST, allowed)
    expected = [[by_hand(functions[k], values[k, d], allowed[k]) for d in range(2)] for k in range(2)]
    np.testing.assert_array_equal(found, expected)


def test_fewer_functions_than_asked_may_be_allowed():
    """Seven of the ten that are asked for; the errors of more are those of all seven."""
    functions, values, allowed = noisy_signals(5)
    allowed[:, 7:] = False
    found = validated_sparsity(functions, values, MOST, allowed)
    expected = [[by_hand(functions[k], values[k, d], allowed[k]) for d in range(2)] for k in range(2)]
    np.testing.assert_array_equal(found, expected)


def test_a_signal_of_few_functions_gets_few():
    functions, values, allowed = noisy_signals(3)
    found = validated_sparsity(functions, values, MOST, allowed)
    assert (found[:, 0] >= 3).all()
    assert (found[:, 1] <= found[:, 0]).all()
    assert (found[:, 1] < MOST).all()

"""Choosing and fitting functions over given domains: scores, widths, and how many functions noise allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sparse_surface.solver.fitting.batch import build_batch
from sparse_surface.solver.fitting.dictionary import Dictionary
from sparse_surface.solver.fitting.sparse_fit import (
    as_wide_as,
    generalisation_score,
    least_squares,
    merge,
    select,
    select_validated,
)
from synthetic import crease, hill, problem

LEGENDRE = Dictionary(14, "legendre")


def test_the_score_weighs_the_misfit_against_the_number_of_functions() -> None:
    """(misfit) / (N - k)^2 by hand: N counts the observations of all signals that have weight, k the functions."""
    weights = np.where(np.arange(100) < 10, 0.0, 1.0)
    batch = build_batch([problem(crease, 10, weights=weights)])
    few, many = (
        least_squares(batch, LEGENDRE, batch.start, np.tile(np.arange(count), (1, 3, 1))) for count in (10, 28)
    )
    functions = LEGENDRE.evaluate(batch.start[:, 0])[:, 10:]
    for fit, count in ((few, 10), (many, 28)):
        left = sum(np.linalg.lstsq(functions[:count].T, values[10:], rcond=None)[1][0] for values in batch.values[0])
        assert generalisation_score(batch, fit)[0] == pytest.approx(left / (3 * 90 - 3 * count) ** 2, rel=1e-6)
    unused = least_squares(batch, LEGENDRE, batch.start, np.tile(np.r_[np.arange(10), [-1] * 5], (1, 3, 1)))
    assert generalisation_score(batch, unused)[0] == pytest.approx(generalisation_score(batch, few)[0], rel=1e-9)


def test_a_support_gets_the_places_of_another_one() -> None:
    batch = build_batch([problem(hill, 8)])
    fit = least_squares(batch, LEGENDRE, batch.start, np.tile(np.arange(4), (1, 3, 1)))
    narrow, wide = np.tile([7, 3], (1, 3, 1)), np.tile([9, 8, 2, 1, 5, 6], (1, 3, 1))
    np.testing.assert_array_equal(as_wide_as(fit, narrow), np.tile([7, 3, -1, -1], (1, 3, 1)))
    np.testing.assert_array_equal(as_wide_as(fit, wide), np.tile([9, 8, 2, 1], (1, 3, 1)))


def test_merging_takes_each_problem_whole() -> None:
    batch = build_batch([problem(hill, 8), problem(crease, 8)])
    one, other = (select(batch, LEGENDRE, batch.start, 6, pursuit) for pursuit in ("ols", "omp"))
    both = merge(np.array([True, False]), one, other)
    for name in ("support", "coefficients", "functions", "inverse_factor", "residual"):
        np.testing.assert_array_equal(getattr(both, name)[0], getattr(one, name)[0])
        np.testing.assert_array_equal(getattr(both, name)[1], getattr(other, name)[1])


@pytest.mark.parametrize("pursuit", ["ols", "omp", "sklearn"])
def test_noise_alone_is_worth_no_function_beyond_the_first(pursuit: str) -> None:
    """The largest of n squared normal numbers stays below 2 ln n in most of many trials, and often exceeds ln n."""
    one_each = trials = 0
    for seed in range(15):
        rng = np.random.default_rng(seed)
        flat = problem(lambda u, v: 0.0 * u, 16, seed=seed)
        noisy = replace(flat, values=rng.normal(0.0, 0.01, flat.values.shape), noise=0.01)
        support = select(batch := build_batch([noisy]), LEGENDRE, batch.start, 15, pursuit).support
        one_each += int(((support >= 0).sum(axis=-1) <= 1).sum())
        trials += support.shape[1]
    assert one_each > 0.8 * trials


def test_validated_signals_get_what_a_pursuit_of_their_number_chooses() -> None:
    """Each as if it were alone: two problems whose signals are a plane, a hill and a crease, with noise."""
    rng = np.random.default_rng(2)
    problems = [problem(shape, 12, seed=k) for k, shape in enumerate((hill, crease))]
    problems = [replace(each, values=each.values + rng.normal(0.0, 0.01, each.values.shape)) for each in problems]
    batch = build_batch(problems)
    support = select_validated(batch, LEGENDRE, batch.start, 12, "ols").support
    used = (support >= 0).sum(axis=-1)
    assert len(np.unique(used)) > 1
    for count in np.unique(used):
        alone = select(batch, LEGENDRE, batch.start, int(count), "ols").support
        for k, signal in zip(*np.nonzero(used == count), strict=True):
            np.testing.assert_array_equal(support[k, signal, :count], alone[k, signal])


def test_less_noise_allows_more_functions() -> None:
    counts = [
        (select(batch := build_batch([replace(problem(crease, 14), noise=noise)]), LEGENDRE, batch.start, 15, "ols"))
        .support[0, 2]
        .tolist()
        for noise in (0.3, 0.03, 0.003, 0.0)
    ]
    used = [sum(k >= 0 for k in chosen) for chosen in counts]
    assert used == sorted(used)
    assert used[0] < 5 < used[2] <= used[3] == 15


@pytest.mark.parametrize("pursuit", ["ols", "omp", "sklearn"])
@pytest.mark.parametrize(("share", "count"), [(0.8, 1), (1.25, 2)])
def test_a_function_is_taken_when_it_gains_more_than_the_largest_gain_on_noise(
    pursuit: str, share: float, count: int
) -> None:
    """The signal is a constant and one more function; what the latter gains is a share of 2 sigma^2 ln n."""
    batch = build_batch([problem(hill, 14)], turn=False)
    function = LEGENDRE.evaluate(batch.start[:, 0])[7]
    varying = function - function.mean()
    variance = 1e-4
    gain = share * 2.0 * np.log(LEGENDRE.size) * variance
    signal = 5.0 + np.sqrt(gain) * varying / np.linalg.norm(varying)
    noisy = replace(batch, values=np.tile(signal, (1, 3, 1)), noise=np.array([variance]))
    support = select(noisy, LEGENDRE, batch.start, 15, pursuit).support
    assert ((support >= 0).sum(axis=-1) == count).all()
    assert (np.sort(support)[..., -count:] == [0, 7][:count]).all()

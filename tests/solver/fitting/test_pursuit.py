"""The pursuits against scikit-learn and against brute force with least squares."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from sklearn.linear_model import orthogonal_mp
from sparse_surface.solver.fitting.dictionary import Dictionary
from sparse_surface.solver.fitting.pursuit import least_squares_pursuit, matching_pursuit, reference_pursuit
from synthetic import crease, grid, hill

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def random_patch(seed: int, degree: int = 14) -> tuple[Array, Array]:
    """Return the dictionary (n, N) on a patch and three signals (3, N): a crease or a hill over a turned domain."""
    rng = np.random.default_rng(seed)
    domain, _ = grid(int(rng.integers(12, 16)), seed)
    angle = rng.uniform(0.0, 2 * np.pi)
    u, v = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ domain.T * 0.7
    height = (crease if seed % 2 else hill)(*domain.T)
    signals = np.stack([u + 0.1 * height, v - 0.2 * height, height])
    signals = signals - signals.mean(axis=1, keepdims=True)
    return Dictionary(degree, "monomial").evaluate(np.stack([u, v])), signals


def problem_of(functions: Array, signals: Array) -> tuple[Array, Array]:
    return (functions @ functions.T)[None], (signals @ functions.T)[None]


def residual_norm(functions: Array, signal: Array, support: Indices) -> float:
    chosen = functions[support]
    scale = np.linalg.norm(chosen, axis=1, keepdims=True)
    coefficients = np.linalg.lstsq((chosen / scale).T, signal, rcond=None)[0]
    return float(np.linalg.norm(signal - coefficients @ (chosen / scale)))


def greedy(functions: Array, signal: Array, size: int, *, orthogonalise: bool) -> list[int]:
    """Choose by brute force: solve every least-squares problem that could be next."""
    chosen: list[int] = []
    for _ in range(size):
        rest = [j for j in range(len(functions)) if j not in chosen]
        if orthogonalise:
            chosen.append(min(rest, key=lambda j: residual_norm(functions, signal, np.array([*chosen, j]))))
        else:
            left = signal
            if chosen:
                left = signal - np.linalg.lstsq(functions[chosen].T, signal, rcond=None)[0] @ functions[chosen]
            chosen.append(max(rest, key=lambda j: abs(functions[j] @ left) / np.linalg.norm(functions[j])))
    return chosen


def test_matching_pursuit_agrees_with_scikit_learn_on_100_patches() -> None:
    for seed in range(100):
        functions, signals = random_patch(seed)
        unit = functions / np.linalg.norm(functions, axis=1, keepdims=True)
        expected = orthogonal_mp(unit.T, signals.T, n_nonzero_coefs=15, precompute=True)
        support = matching_pursuit(*problem_of(functions, signals), 15)[0]
        for signal in range(3):
            assert set(support[signal]) == set(np.flatnonzero(expected[:, signal])), f"patch {seed}, signal {signal}"


def test_the_reference_chooses_what_matching_pursuit_does() -> None:
    problems = [problem_of(*random_patch(seed)) for seed in range(20)]
    gram, correlation = (np.concatenate(parts) for parts in zip(*problems, strict=True))
    allowed = np.arange(120) < np.where(np.arange(20) % 2 == 0, 120, 45)[:, None]
    worth = np.where(np.arange(20) % 3 == 0, 0.0, 1e-3)
    own = matching_pursuit(gram, correlation, 15, allowed, worth)
    np.testing.assert_array_equal(
        np.sort(own, axis=-1), np.sort(reference_pursuit(gram, correlation, 15, allowed, worth), axis=-1)
    )
    assert 0 < (own < 0).mean() < 1


@pytest.mark.parametrize("seed", range(4))
def test_matching_pursuit_chooses_what_is_most_parallel_to_the_residual(seed: int) -> None:
    functions, signals = random_patch(seed, degree=6)
    support = matching_pursuit(*problem_of(functions, signals), 7)[0]
    for signal in range(3):
        assert list(support[signal]) == greedy(functions, signals[signal], 7, orthogonalise=False)


@pytest.mark.parametrize("seed", range(4))
def test_least_squares_pursuit_chooses_what_lowers_the_residual_most(seed: int) -> None:
    functions, signals = random_patch(seed, degree=6)
    support = least_squares_pursuit(*problem_of(functions, signals), 7, replacements=0)[0]
    for signal in range(3):
        assert list(support[signal]) == greedy(functions, signals[signal], 7, orthogonalise=True)


@given(seed=st.integers(0, 2**32 - 1), size=st.integers(1, 12))
def test_exchanging_never_loses_and_no_function_stands_twice(seed: int, size: int) -> None:
    functions, signals = random_patch(seed, degree=7)
    problem = problem_of(functions, signals)
    first = least_squares_pursuit(*problem, size, replacements=0)[0]
    second = least_squares_pursuit(*problem, size, replacements=2)[0]
    for signal in range(3):
        assert len(set(second[signal])) == size
        before, after = (residual_norm(functions, signals[signal], s[signal]) for s in (first, second))
        assert after <= before * (1 + 1e-6) + 1e-9


def test_one_exchange_of_each_function_is_the_best_one() -> None:
    functions, signals = random_patch(3, degree=6)
    size = 5
    problem = problem_of(functions, signals)
    support = list(least_squares_pursuit(*problem, size, replacements=0)[0, 2])
    for position in range(size):
        others = support[:position] + support[position + 1 :]
        rest = [j for j in range(len(functions)) if j not in others]
        support[position] = min(rest, key=lambda j: residual_norm(functions, signals[2], np.array([*others, j])))
    assert list(least_squares_pursuit(*problem, size, replacements=1)[0, 2]) == support


@pytest.mark.parametrize("seed", range(6))
def test_after_enough_exchanges_none_pays_any_more(seed: int) -> None:
    functions, signals = random_patch(seed, degree=6)
    gram, correlation = problem_of(functions, signals)
    chosen = least_squares_pursuit(gram, correlation, 5, replacements=30, worth=np.array([1e-300]))[0]
    for signal, support in zip(signals, chosen, strict=True):
        present = residual_norm(functions, signal, support)
        for position in range(5):
            for j in set(range(len(functions))) - set(support):
                other = support.copy()
                other[position] = j
                assert residual_norm(functions, signal, other) >= present * (1.0 - 1e-6)


@pytest.mark.parametrize("pursue", [matching_pursuit, least_squares_pursuit])
def test_recovers_signals_of_few_functions(pursue) -> None:
    rng = np.random.default_rng(8)
    functions = Dictionary(8, "legendre").evaluate(rng.uniform(-1, 1, (2, 400)))
    support = np.stack([rng.choice(len(functions), 6, replace=False) for _ in range(3)])
    signals = np.stack([rng.uniform(1.0, 2.0, 6) @ functions[s] for s in support])
    found = pursue(*problem_of(functions, signals), 6)[0]
    for signal in range(3):
        assert set(found[signal]) == set(support[signal])


@pytest.mark.parametrize("pursue", [matching_pursuit, least_squares_pursuit])
def test_problems_of_a_batch_do_not_see_each_other(pursue) -> None:
    problems = [problem_of(*random_patch(seed)) for seed in range(5)]
    together = pursue(np.concatenate([g for g, _ in problems]), np.concatenate([c for _, c in problems]), 12)
    for k, (gram, correlation) in enumerate(problems):
        np.testing.assert_array_equal(together[k], pursue(gram, correlation, 12)[0])


@pytest.mark.parametrize("pursue", [matching_pursuit, least_squares_pursuit, reference_pursuit])
def test_takes_only_what_is_allowed(pursue) -> None:
    dictionary = Dictionary(14, "monomial")
    allowed = (dictionary.degrees.sum(axis=1) <= 5)[None]
    support = pursue(*problem_of(*random_patch(1)), 15, allowed)
    assert dictionary.degrees[support].sum(axis=-1).max() <= 5


@pytest.mark.parametrize("pursue", [matching_pursuit, least_squares_pursuit])
def test_stops_where_the_rest_depends_on_what_is_chosen(pursue) -> None:
    rng = np.random.default_rng(2)
    basis = rng.normal(size=(4, 30))
    functions = np.concatenate([basis, rng.normal(size=(6, 4)) @ basis])
    support = pursue(*problem_of(functions, rng.normal(size=(3, 30))), 7)[0]
    assert ((support >= 0).sum(axis=1) == 4).all()
    assert (np.diff((support < 0).astype(int), axis=1) >= 0).all()
    for chosen in support:
        assert np.linalg.matrix_rank(functions[chosen[chosen >= 0]]) == 4


@pytest.mark.parametrize("pursue", [matching_pursuit, least_squares_pursuit, reference_pursuit])
def test_a_signal_of_zeros_is_no_trouble(pursue) -> None:
    functions, signals = random_patch(0)
    for chosen in pursue(*problem_of(functions, signals * 0.0), 15)[0]:
        used = chosen[chosen >= 0]
        assert len(set(used)) == len(used)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_polynomials_of_low_degree_are_found_on_any_points(degree: int) -> None:
    """A choice one at a time, and exchanges one at a time, miss some of them: a tilted plane on scattered points."""
    dictionary = Dictionary(8, "legendre")
    missed = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        functions = dictionary.evaluate(rng.uniform(-1.0, 1.0, (2, 50)) ** 3)
        low = (degree + 1) * (degree + 2) // 2
        signals = rng.normal(size=(3, low)) @ functions[:low]
        problem = problem_of(functions, signals)
        for chosen, signal in zip(least_squares_pursuit(*problem, 10)[0], signals, strict=True):
            used = functions[chosen[chosen >= 0]]
            left = signal - np.linalg.lstsq(used.T, signal, rcond=None)[0] @ used
            assert np.abs(left).max() < 1e-9 * np.abs(signal).max()
        greedy = least_squares_pursuit(*problem, 10, worth=np.array([1e-300]))[0]
        missed += any(not set(range(low)) <= set(chosen) for chosen in greedy)
    assert missed > 0 or degree > 1

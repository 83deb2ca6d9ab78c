"""The kernel's pursuits against scikit-learn and brute force."""

from __future__ import annotations

from ctypes import c_double, c_void_p

import numpy as np
import pytest
from numpy.polynomial import legendre
from sklearn.linear_model import orthogonal_mp_gram
from sparse_surface.solver.arrays import Array, Indices
from sparse_surface.solver.native.library import function
from synthetic import crease, grid, hill

DONE = 0


def pursue(gram: Array, correlation: Array, s: int, instructions: str, ols: bool = True, worth: float = 0.0) -> Indices:
    support = np.empty(s, dtype=np.int64)
    gram, correlation = np.ascontiguousarray(gram), np.ascontiguousarray(correlation)
    status = function("pursue", instructions)(
        c_void_p(gram.ctypes.data),
        c_void_p(correlation.ctypes.data),
        len(gram),
        s,
        ols,
        c_double(worth),
        c_void_p(support.ctypes.data),
    )
    assert status == DONE
    return support


def patch(seed: int, degree: int = 8) -> tuple[Array, Array]:
    """Return functions (n, N) by total degree, and a signal (N,) that takes many of them."""
    domain, _ = grid(13, seed)
    u, v = legendre.legvander(domain[:, 0], degree), legendre.legvander(domain[:, 1], degree)
    functions = [u[:, total - j] * v[:, j] for total in range(degree + 1) for j in range(total + 1)]
    return np.array(functions), (crease if seed % 2 else hill)(*domain.T)


def left_over(functions: Array, signal: Array, support: list[int]) -> float:
    if not support:
        return float(signal @ signal)
    solution = np.linalg.lstsq(functions[support].T, signal, rcond=None)[0]
    rest = signal - solution @ functions[support]
    return float(rest @ rest)


@pytest.mark.parametrize("seed", range(6))
def test_matching_pursuit_chooses_what_scikit_learn_chooses(instructions: str, seed: int) -> None:
    functions, signal = patch(seed)
    functions = functions / np.linalg.norm(functions, axis=1, keepdims=True)
    chosen = pursue(functions @ functions.T, functions @ signal, 8, instructions, ols=False)
    expected = orthogonal_mp_gram(functions @ functions.T, functions @ signal, n_nonzero_coefs=8)
    assert sorted(chosen) == list(np.flatnonzero(expected))


@pytest.mark.parametrize("seed", range(4))
def test_least_squares_pursuit_is_no_worse_than_greedy_choice_and_no_exchange_improves_on_it_at_first(
    instructions: str, seed: int
) -> None:
    functions, signal = patch(seed)
    s = 7
    greedy = greedily(functions, signal, s)
    chosen = [int(j) for j in pursue(functions @ functions.T, functions @ signal, s, instructions)]
    assert len(set(chosen)) == s
    assert left_over(functions, signal, chosen) <= left_over(functions, signal, greedy) * (1 + 1e-9)
    # the last place was exchanged last: nothing does better there
    others = [j for j in range(len(functions)) if j not in chosen]
    best = min(left_over(functions, signal, [*chosen[:-1], j]) for j in [*others, chosen[-1]])
    assert left_over(functions, signal, chosen) <= best * (1 + 1e-6)


def greedily(functions: Array, signal: Array, s: int) -> list[int]:
    """Choose functions by least squares for every candidate."""
    chosen: list[int] = []
    for _ in range(s):
        rest = [j for j in range(len(functions)) if j not in chosen]
        chosen.append(min(rest, key=lambda j: left_over(functions, signal, [*chosen, j])))
    return chosen


@pytest.mark.parametrize("seed", range(4))
def test_exchanges_are_those_of_least_squares_for_every_candidate(instructions: str, seed: int) -> None:
    functions, signal = patch(seed, degree=6)
    expected = greedily(functions, signal, 9)
    for place in range(9):
        others = expected[:place] + expected[place + 1 :]
        rest = [j for j in range(len(functions)) if j not in others]
        expected[place] = min(rest, key=lambda j: left_over(functions, signal, [*others, j]))
    assert list(pursue(functions @ functions.T, functions @ signal, 9, instructions)) == expected


def test_exchanges_are_made_however_little_they_gain(instructions: str) -> None:
    rng, ratios = np.random.default_rng(3), []
    for _ in range(80):
        functions = rng.normal(size=(12, 30)) + rng.normal(size=30)
        signal = rng.normal(size=30) + rng.normal(size=12) @ functions
        expected = greedily(functions, signal, 4)
        for place in range(4):
            others = expected[:place] + expected[place + 1 :]
            rest = [j for j in range(len(functions)) if j not in others]
            left = {j: left_over(functions, signal, [*others, j]) for j in rest}
            best, without = min(rest, key=left.__getitem__), left_over(functions, signal, others)
            ratios.append((without - left[best]) / (without - left[expected[place]]))
            expected[place] = best
        assert list(pursue(functions @ functions.T, functions @ signal, 4, instructions, worth=1e-300)) == expected
    gained = np.array(ratios)[np.array(ratios) > 1.0]
    assert gained.min() < 1.1
    assert gained.max() > 1.5


@pytest.mark.parametrize("own_part", [1e-2, 1e-3, 1e-4])
def test_exchanging_functions_that_nearly_depend_on_others_makes_nothing_worse(
    instructions: str, own_part: float
) -> None:
    functions, signal = patch(1, degree=6)
    functions[1:] = functions[:-1] + own_part * functions[1:]
    chosen = [int(j) for j in pursue(functions @ functions.T, functions @ signal, 9, instructions)]
    greedy = left_over(functions, signal, greedily(functions, signal, 9))
    assert left_over(functions, signal, chosen) <= greedy * (1 + 1e-6)


def test_a_polynomial_of_low_degree_is_reproduced_by_all_functions_up_to_its_degree(instructions: str) -> None:
    functions, _ = patch(0)
    signal = np.arange(1.0, 7.0) @ functions[:6]
    chosen = pursue(functions @ functions.T, functions @ signal, 6, instructions)
    assert sorted(chosen) == list(range(6))


def test_functions_that_depend_on_others_are_not_chosen(instructions: str) -> None:
    functions, signal = patch(1, degree=2)
    doubled = np.concatenate([functions, functions])
    chosen = pursue(doubled @ doubled.T, doubled @ signal, 9, instructions)
    assert list(chosen).count(-1) == 3
    assert {int(j) % 6 for j in chosen if j >= 0} == set(range(6))


def test_only_functions_that_explain_more_than_noise_are_chosen(instructions: str) -> None:
    functions, _ = patch(2)
    orthonormal = np.linalg.qr(functions.T)[0].T
    signal = 5.0 * orthonormal[3] + 2.0 * orthonormal[7] + 0.1 * orthonormal[11]
    chosen = pursue(np.eye(len(orthonormal)), orthonormal @ signal, 5, instructions, worth=1.0)
    assert sorted(j for j in chosen if j >= 0) == [3, 7]

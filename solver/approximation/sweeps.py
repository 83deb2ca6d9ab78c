"""Consistent approximation of the whole surface: Gauss-Seidel sweeps over the patches (section 4.2, eq. 6).

The surface at a point is the blend of its patches, so each patch is refitted in turn against what the others leave of
the data, with everything else held.  Patches that share no vertex do not affect each other; they have one colour and
are refitted together.  Eq. 6 constrains only the blend, so overlapping patches could drift apart in opposite
directions: a term gamma |b - h_k|^2 holds each of them near the data.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import count, pairwise

import numpy as np

from ..arrays import Array, Indices
from ..fitting.batch import Problem, WarmStart
from ..fitting.chunks import PatchFit
from ..patches.observations import PatchObservations
from ..patches.patches import Patches

CHUNKS_A_COLOUR = 4
"""A colour is cut into at least this many chunks, for as many workers; the next colour waits for all of them."""

COLOURS_A_NUMBER, ALL_TAKEN = 64, 2**64 - 1
"""Bits of a whole number, and the number with all of them."""

ANTI_DRIFT = 0.1
"""gamma: weight that holds a patch near the data itself, beside the weight of what the others leave."""


def colour_patches(patches: Patches) -> list[Indices]:
    """Split the patches into sets in which no two share a node; first fit in the order of the patches.

    Each node keeps the colours of the patches that hold it as bits of whole numbers.
    """
    colour = np.zeros(len(patches.centres), dtype=np.int64)
    used = [np.zeros(int(patches.nodes.max(initial=-1)) + 1, dtype=np.uint64)]
    for k, (start, end) in enumerate(pairwise(patches.vertex_offsets.tolist())):
        own = patches.nodes[start:end]
        for number in count():
            if number == len(used):
                used.append(np.zeros_like(used[0]))
            taken = int(np.bitwise_or.reduce(used[number][own]))
            if taken < ALL_TAKEN:
                break
        bit = ((taken + 1) & ~taken).bit_length() - 1  # the lowest that is not set
        used[number][own] |= np.uint64(1 << bit)
        colour[k] = COLOURS_A_NUMBER * number + bit
    return [np.flatnonzero(colour == c) for c in range(colour.max(initial=-1) + 1)]


def against_remainder(
    problems: list[Problem], own: PatchObservations, left: Array, fit: PatchFit, keep_balance: bool
) -> list[Problem]:
    """Turn a patch's problems into those of a sweep, started from its fit.

    Targets and weights change so that least squares minimise, with phi the patch's blending weight and h its surface,

        sum w (phi^2 |left / phi - h|^2 + gamma |data - h|^2).

    Parameters
    ----------
    problems
        The patch's problems by itself, one a domain.
    own
        The patch's N observations.
    left
        What the other patches leave of the data, phi times the patch's target, (N, 3).
    fit
        The fit so far.
    keep_balance
        Whether weights keep their sum, and so their balance with the regularisation.  The paper's methods take eq. 6 as
        it is printed: without gamma, and with the small weights 1 / n_p^2 beside an unchanged Q.
    """
    anti_drift = ANTI_DRIFT if keep_balance else 0.0
    share = own.blending**2 + anti_drift
    weights = own.weights * share
    if keep_balance:
        weights *= problems[0].weights.sum() / max(weights.sum(), 1e-300)
    signals = np.cumsum([0] + [problem.values.shape[1] for problem in problems])
    result = []
    for c, problem in enumerate(problems):
        part = slice(signals[c], signals[c + 1])
        target = own.blending[:, None] * left[:, part] + anti_drift * problem.values
        # Where the patch has no weight at all the target does not matter.
        np.divide(target, share[:, None], out=target, where=share[:, None] > 0.0)
        warm = WarmStart(fit.frames[c], fit.domain[c], fit.support[part])
        result.append(replace(problem, values=target, weights=weights, warm=warm))
    return result

"""Consistent approximation of the whole surface: Gauss-Seidel sweeps over the patches (section 4.2, eq. 6).

The surface at a point is the blend of its patches, so each patch is re-fitted in turn against what the others leave
of the data, with everything else held.  Patches that share no vertex do not see each other; they have one colour and
are re-fitted together. Eq. 6 constrains only the blend, so overlapping patches could drift apart in opposite
directions: a term gamma |b - h_k|^2 holds each of them near the data.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..fitting.batch import Problem, WarmStart
from ..fitting.chunks import ChunkTask, PatchFit, chunk_patches, problems_of
from ..patch_methods import METHODS
from ..patches.observations import Observations, PatchObservations
from ..patches.patches import Patches
from ..settings import Settings

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

PIECES = 4
"""Chunks into which a colour is cut, for as many workers; the next colour waits for all of them."""

ANTI_DRIFT = 0.1
"""gamma: weight that holds a patch near the data itself, beside the weight of what the others leave."""


class Blend:
    """The blended surface at the observations, kept up to date while patches change."""

    def __init__(self, observations: Observations) -> None:
        self.observations, self.patches = observations, observations.patches
        self._surface = observations.points.copy()

    def add(self, patch: int, fit: PatchFit) -> None:
        """Add a patch's part to the surface: the data gives way to it."""
        own = self.observations.of_patch(patch)
        self._surface[own.number] += own.blending[:, None] * (fit.values - self.observations.points[own.number])

    def exchange(self, patch: int, before: PatchFit, after: PatchFit) -> None:
        """Replace a patch's part of the surface."""
        own = self.observations.of_patch(patch)
        self._surface[own.number] += own.blending[:, None] * (after.values - before.values)

    def at_first(self, count: int) -> Array:
        """The surface at the first observations, (count, 3): the data where patches are missing."""
        return self._surface[:count].copy()

    def remainder(self, own: PatchObservations, fit: PatchFit) -> Array:
        """What the other patches leave for one at its observations, phi_k times its target, (N, 3)."""
        left = self.observations.points[own.number] - self._surface[own.number]
        left += own.blending[:, None] * fit.values
        return left


def colour_patches(patches: Patches) -> list[Indices]:
    """Split the patches into sets in which no two share a vertex; first fit in the order of the patches."""
    count = len(patches.centres)
    shape = (count, int(patches.vertices.max(initial=-1)) + 1)
    holds = sp.csr_matrix((np.ones(len(patches.vertices)), (patches.vertex_patch, patches.vertices)), shape=shape)
    touching = (holds @ holds.T).tocsr()
    colour = np.full(count, -1)
    for k in range(count):
        taken = colour[touching.indices[touching.indptr[k] : touching.indptr[k + 1]]]
        free = np.ones(len(taken) + 1, dtype=bool)
        free[taken[(taken >= 0) & (taken < len(free))]] = False
        colour[k] = int(np.argmax(free))
    return [np.flatnonzero(colour == c) for c in range(colour.max(initial=-1) + 1)]


def sweep(
    blend: Blend,
    domains: Array,
    fits: list[PatchFit],
    settings: Settings,
    run: Callable[[Iterable[ChunkTask]], Iterator[tuple[ChunkTask, list[PatchFit]]]],
) -> Iterator[int]:
    """One Gauss-Seidel pass over all patches; changes `fits` and `blend`, yields how many patches a step re-fitted.

    Parameters
    ----------
    blend
        The surface of `fits`.
    domains
        Initial domains in scene units, (M, 2).
    fits
        What each patch has; replaced where the patch's own objective fell.
    settings
        Resolved settings.
    run
        Fits chunks, in order.
    """
    for colour in colour_patches(blend.patches):
        chunks = chunk_patches(blend.observations, colour, settings.channels, PIECES)
        tasks = (sweep_task(blend, domains, fits, settings, chunk) for chunk in chunks)
        for task, fitted in run(tasks):
            for patch, fit in zip(task.patches, fitted, strict=True):
                blend.exchange(int(patch), fits[patch], fit)
                fits[patch] = _following(fit, fits[patch])
            yield len(fitted)


def _following(fit: PatchFit, first: PatchFit) -> PatchFit:
    """A sweep minimises another objective: what is told of the iterations stays that of the patch by itself (eq. 3)."""
    return replace(fit, energy=first.energy, squared_error=first.squared_error, history=first.history)


def sweep_task(blend: Blend, domains: Array, fits: list[PatchFit], settings: Settings, chunk: Indices) -> ChunkTask:
    """Problems of some patches against what all the others leave, started from where they stand."""
    problems = []
    for k in map(int, chunk):
        own = blend.observations.of_patch(k)
        alone = problems_of(blend.observations, own, domains, settings, k)
        problems += _against_remainder(blend, own, alone, fits[k], METHODS[settings.method].keeps_balance)
    return ChunkTask(chunk, problems, settings)


def _against_remainder(
    blend: Blend, own: PatchObservations, problems: list[Problem], fit: PatchFit, anchored: bool
) -> list[Problem]:
    """Change targets and weights so that least squares mean w0 (phi^2 |left / phi - h|^2 + gamma |data - h|^2).

    The paper's methods take eq. 6 as it is printed: without gamma, and with the small weights 1 / n_p^2 beside an
    unchanged Q.  Otherwise (`anchored`) the weights keep their sum, and so their balance with Q.
    """
    left = blend.remainder(own, fit)
    anti_drift = ANTI_DRIFT if anchored else 0.0
    share = own.blending**2 + anti_drift
    weights = own.weights * share
    if anchored:
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

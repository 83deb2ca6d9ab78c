"""Fitting chunks of patches: from patches and their initial domains to sparse coefficients, by any method.

A chunk's fits are a pure function of its task: the same bytes in any process and in any order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array, Indices
from ..patch_methods import METHODS
from ..patches.blending import fitting_weights
from ..patches.observations import Observations, PatchObservations
from ..processes.threads import one_thread
from ..settings import Settings
from .batch import Batch, Frame, Problem, build_batch, warm_starts
from .dictionary import Dictionary
from .methods import solver_of
from .solution import Solution

SWEEP_ITERATIONS = 3
"""Iterations when a sweep refits a patch."""

CHUNK_PROBLEMS = 64
CHUNK_SIZE = 7_500
"""Largest number of problems in a chunk, and of their vertices and triangles: more would not fit into the cache."""

NO_VALUES: Array = np.zeros((0, 3))

TINY_CHUNK = 4
"""Smallest number of problems for which a chunk is cut: with fewer, Python takes longer than the arithmetic."""


@dataclass(frozen=True)
class ChunkTask:
    """All that a worker needs to fit some patches.

    Attributes
    ----------
    patches
        Numbers of the patches.
    problems
        One problem a patch and domain, patch by patch.
    settings
        Resolved settings.
    """

    patches: Indices
    problems: list[Problem]
    settings: Settings


@dataclass(frozen=True)
class PatchFit:
    """One fitted patch; C domains, m vertices, N observations, s functions.

    Attributes
    ----------
    frames
        Frame of each domain.
    initial_domain, domain
        In the frames, (C, m, 2).
    support, coefficients
        (3, s).
    values
        The patch's own surface at its observations, (N, 3), scene units.
    energy
        Objective after each iteration, (n,), summed over the domains, in the patch's scale.
    squared_error
        Sum over the observations of the squared distance from the data after each iteration, (n,), scene units.
    history
        The patch's surface at its vertices after each iteration, (n, m, 3); None unless the settings keep it.
    """

    frames: list[Frame]
    initial_domain: Array
    domain: Array
    support: Indices
    coefficients: Array
    values: Array
    energy: Array
    squared_error: Array
    history: Array | None = None

    def without_values(self) -> PatchFit:
        """The same fit without its values, for there are many fits: `dataclasses.replace` takes five times as long."""
        kept = self.frames, self.initial_domain, self.domain, self.support, self.coefficients
        return PatchFit(*kept, NO_VALUES, self.energy, self.squared_error, self.history)

    def with_iterations_of(self, before: PatchFit) -> PatchFit:
        """The same fit with another one's history: a sweep minimises eq. 6, and eq. 3 is what is shown."""
        kept = self.frames, self.initial_domain, self.domain, self.support, self.coefficients, self.values
        return PatchFit(*kept, before.energy, before.squared_error, before.history)


def chunk_task(observations: Observations, domains: Array, settings: Settings, chunk: Indices) -> ChunkTask:
    """Gather the task of fitting the patches `chunk`.

    Parameters
    ----------
    observations
        What the patches are fitted to.
    domains
        Initial domains in scene units, (M, 2).
    settings
        Resolved settings.
    chunk
        Numbers of the patches.
    """
    each = (problems_of(observations, observations.of_patch(k), domains, settings, k) for k in map(int, chunk))
    return ChunkTask(chunk, [problem for problems in each for problem in problems], settings)


def chunk_patches(observations: Observations, which: Indices, problems_each: int = 1, pieces: int = 1) -> list[Indices]:
    """Sort the patches `which` by size and cut them into chunks that fit into the cache, the largest patches first.

    There are at least `pieces` chunks, unless they would become tiny: what follows waits for all of them, and least for
    a last one with small patches.  The number of workers plays no part, as the composition of a chunk decides how sums
    are rounded.
    """
    most = min(CHUNK_PROBLEMS, max(TINY_CHUNK, -(-len(which) * problems_each // pieces)))
    size = observations.sizes[which]
    order = which[np.argsort(size, kind="stable")]
    size = np.sort(size, kind="stable").tolist()
    chunks, start = [], 0
    for end in range(1, len(order) + 1):
        if end < len(order):
            problems = (end + 1 - start) * problems_each
            if problems <= most and problems * size[end] <= CHUNK_SIZE:
                continue
        chunks.append(order[start:end])
        start = end
    return chunks[::-1]


def problems_of(
    observations: Observations, own: PatchObservations, domains: Array, settings: Settings, patch: int
) -> list[Problem]:
    """Problems of the patch whose observations are `own`: one for x, y and z together, or one for each."""
    patches = observations.patches
    vertices = slice(*patches.vertex_offsets[patch : patch + 2])
    triangles = patches.triangles[slice(*patches.triangle_offsets[patch : patch + 2])]
    weights = fitting_weights(own.blending, own.weights, settings.blending)
    at_vertices, values = observations.vertices[patches.vertices[vertices]], observations.points[own.number]
    degree, each = min(settings.degree, own.degree), 3 // settings.channels
    return [
        Problem(
            domains[vertices],
            triangles,
            at_vertices[:, part],
            own.corners,
            own.shares,
            values[:, part],
            weights,
            degree,
            own.noise,
            own.ends_early,
        )
        for part in (slice(first, first + each) for first in range(0, 3, each))
    ]


def fit_chunk(task: ChunkTask) -> list[PatchFit]:
    """Fit the patches of a chunk on one thread.

    A chunk is never cut when memory runs out: its composition decides how sums are rounded, and the same input must
    give the same bytes.

    Raises
    ------
    MemoryError
        In one sentence that says what needs less.
    """
    try:
        return _fit_batch(task)
    except MemoryError:
        size = max(len(problem.domain) for problem in task.problems)
        raise MemoryError(
            f"There is not enough memory for {len(task.patches)} patches of up to {size} vertices; "
            "fewer workers, a smaller ring or a lower degree need less."
        ) from None


def _fit_batch(task: ChunkTask) -> list[PatchFit]:
    settings = task.settings
    with one_thread():
        batch = build_batch(task.problems, turn=METHODS[settings.method].turns_domain)
        # Functions are numbered by total degree, so a smaller dictionary has the same numbers.
        dictionary = Dictionary(min(settings.degree, int(batch.degrees.max())), settings.basis)
        solution = _solution(batch, dictionary, task)
        observed = batch.observed(solution.domain)[:, :, None]
        fitted = dictionary.sparse_values(solution.support, solution.coefficients, observed)
    each = len(task.problems) // len(task.patches)
    return [
        _patch_fit(batch, solution, fitted, len(task.problems[k].values), slice(k, k + each))
        for k in range(0, batch.problems, each)
    ]


def _solution(batch: Batch, dictionary: Dictionary, task: ChunkTask) -> Solution:
    """Solve from scratch, or improve earlier solutions, by the method of the settings."""
    solver, settings = solver_of(task.settings), task.settings
    if task.problems[0].warm is None:
        return solver.solve(batch, dictionary, settings)
    domain, support = warm_starts(task.problems, batch.start)
    iterations = min(SWEEP_ITERATIONS, settings.iterations)
    return solver.improve(batch, dictionary, settings, domain, support, iterations)


def _patch_fit(batch: Batch, solution: Solution, fitted: Array, observations: int, part: slice) -> PatchFit:
    """Take the problems `part` of one patch out of a batch, in scene units; `fitted` is (B, D, N)."""
    size, frames, trace = batch.sizes[part.start], batch.frames[part], solution.trace
    initial, domain = (a[:, part, :size].transpose(1, 2, 0).copy() for a in (batch.start, solution.domain))
    scales = np.array([frame.scale for frame in frames])
    history = [_in_scene_units(values[part, :, :size], frames) for values in trace.values]
    return PatchFit(
        frames,
        initial,
        domain,
        solution.support[part].reshape(3, -1),
        solution.coefficients[part].reshape(3, -1),
        _in_scene_units(fitted[part, :, :observations], frames),
        np.array([energy[part].sum() for energy in trace.energy]),
        np.array([(squares[part] / scales**2).sum() for squares in trace.squared_error]),
        np.stack(history) if history else None,
    )


def values_at(fit: PatchFit, observations: PatchObservations, settings: Settings) -> Array:
    """A fitted patch's own surface at other observations of its triangles, (N, 3), scene units."""
    dictionary = Dictionary(settings.degree, settings.basis)
    place = np.einsum("nk,cnkx->xcn", observations.shares, fit.domain[:, observations.corners])
    count = len(fit.frames)
    support = fit.support.reshape(count, 3 // count, -1)
    coefficients = fit.coefficients.reshape(count, 3 // count, -1)
    return _in_scene_units(dictionary.sparse_values(support, coefficients, place[:, :, None]), fit.frames)


def with_values_at(fit: PatchFit, observations: PatchObservations, settings: Settings) -> PatchFit:
    """The same fit with its values at other observations of its triangles."""
    return replace(fit, values=values_at(fit, observations, settings))


def _in_scene_units(values: Array, frames: list[Frame]) -> Array:
    """Points (N, 3) from values (C, 3 / C, N) in C frames."""
    parts = [own.T / frame.scale + frame.origin for own, frame in zip(values, frames, strict=True)]
    return np.ascontiguousarray(np.concatenate(parts, axis=1))

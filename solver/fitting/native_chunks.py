"""Fitting the problems of a chunk by the compiled kernel: arrays in, the fits of `chunks` out."""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import byref, c_int64, c_void_p
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..native.library import NativeSettings, function, reason_for_numpy
from ..native.observations import Gathered
from ..settings import Settings
from . import chunks as by_numpy
from .batch import Frame, Problem, WarmStart
from .chunks import ChunkTask, PatchFit
from .gathered import MeshTask, Task
from .methods.variable_projection import rigidity_decay

DONE, OUT_OF_MEMORY = 0, 1
"""Of `Status` in kernel.h; anything else means that the arrays contradict each other."""

FRAME_SIZE = 10
"""Numbers of a frame: centre, turn, origin, scale."""

SUPPORT = 3
"""Place of the functions' numbers, which are integers, among the arrays of `_Solved`."""

NUMBER_SIZE = 8
"""Bytes of a number, whole or not."""

COUNTS = 8
"""Fields of `Problem` in kernel.h before `noise`: those of `_sizes`; behind it are addresses."""


@dataclass(frozen=True)
class _Solved:
    """Arrays of one problem that the kernel fills in, in the order of `Problem` in kernel.h."""

    frame: Array
    start: Array
    solved: Array
    support: Indices
    coefficients: Array
    fitted: Array
    energy: Array
    squared_error: Array
    history: Array | None


def _width(settings: Settings, functions: int, observations: int) -> int:
    """Places for functions: no more than there are observations, beyond which all functions depend on others."""
    return min(settings.sparsity, functions, observations)


def _sizes(problem: Problem, settings: Settings) -> tuple[int, ...]:
    """Vertices m, triangles t, observations N, signals D, degree, places for functions s, warm, ends early."""
    size, signals = problem.signals.shape
    observations, warm = len(problem.values), problem.warm
    functions = (problem.degree + 1) * (problem.degree + 2) // 2
    width = _width(settings, functions, observations) if warm is None else warm.support.shape[1]
    counts = size, len(problem.triangles), observations, signals
    return *counts, problem.degree, width, warm is not None, problem.ends_early


def _as_numbers(frame: Frame) -> Array:
    origin = np.zeros(3)
    origin[: len(frame.origin)] = frame.origin
    return np.concatenate([frame.centre, frame.turn.ravel(), origin, [frame.scale]])


def _as_frame(numbers: Array, signals: int) -> Frame:
    turn = numbers[2:6].reshape(2, 2).copy()
    return Frame(numbers[:2].copy(), turn, numbers[6 : 6 + signals].copy(), float(numbers[9]))


def fit_chunk(task: Task) -> list[PatchFit]:
    """Fit the patches of a chunk on this thread, by the compiled kernel or by NumPy.

    Raises
    ------
    MemoryError
        When it does not suffice, with a sentence that says so.
    """
    if reason_for_numpy(task.settings) is None:
        return fit_natively(task)
    return by_numpy.fit_chunk(task.in_full() if isinstance(task, MeshTask) else task)


def fit_natively(task: Task, instructions: str | None = None) -> list[PatchFit]:
    """Fit the patches of a chunk on this thread; what a patch becomes depends on nothing else in the chunk.

    Raises
    ------
    MemoryError
        When it does not suffice for the largest patch, with a sentence that says so.
    ValueError
        When an observation lies in no triangle of its patch, or a function is not in the dictionary.
    """
    fit_problems = function("fit_problems", instructions)
    try:
        prepared = Prepared.of_task(task)
        count = len(prepared.solved)
        status = fit_problems(prepared.address, c_int64(count), byref(native_settings(task.settings)))
    except MemoryError:
        status = OUT_OF_MEMORY
    check(status, _largest_size(task))
    patches = len(task.patches)
    if isinstance(task, MeshTask):
        return [_patch_fit(prepared.solved[k::patches]) for k in range(patches)]
    each = count // patches
    return [_patch_fit(prepared.solved[k : k + each]) for k in range(0, count, each)]


def _largest_size(task: Task) -> int:
    """Vertices of the largest patch."""
    if isinstance(task, MeshTask):
        return int(task.observed.sizes(task.patches)[0].max())
    return max(len(problem.domain) for problem in task.problems)


def check(status: int, size: int) -> None:
    """Raise what a status of the kernel means, for patches of up to `size` vertices."""
    if status == OUT_OF_MEMORY:
        raise MemoryError(
            f"There is not enough memory for a patch of {size} vertices; a smaller ring or a lower degree needs less."
        )
    if status != DONE:
        raise ValueError(f"The arrays of a patch contradict each other (status {status} of the compiled kernel).")


def native_settings(settings: Settings) -> NativeSettings:
    """What the kernel has to know of the settings."""
    return NativeSettings(
        settings.sparsity,
        settings.iterations,
        settings.basis == "legendre",
        settings.pursuit == "ols",
        settings.beta1,
        settings.beta2,
        rigidity_decay(settings),
    )


@dataclass(frozen=True)
class Prepared:
    """Problems as the kernel takes them: like arrays of all of them stand in one, so that few calls find addresses.

    Attributes
    ----------
    natives
        `Problem` of kernel.h for each: sizes, noise, addresses, (n, fields).
    inputs
        The arrays that these point at and the kernel reads: they have to live until it returns.
    solved
        What it fills in.
    """

    natives: Indices
    inputs: list[NDArray[Any]]
    solved: list[_Solved]

    @property
    def address(self) -> c_void_p:
        """Where the first problem stands."""
        return c_void_p(self.natives.ctypes.data)

    @classmethod
    def of_task(cls, task: Task) -> Prepared:
        """Prepare the problems of a task; those of a `MeshTask` begin with all patches' first domains."""
        if isinstance(task, ChunkTask):
            return cls.of(task.problems, task.settings)
        given, warm, settings, channels = task.gathered(), task.warm, task.settings, task.settings.channels
        observations, functions = np.diff(given.blends.offsets), (task.degrees + 1) * (task.degrees + 2) // 2
        width = np.minimum(np.minimum(observations, functions), settings.sparsity)
        if task.remainder is not None:
            width = np.array([fit.support.shape[1] for fit in task.remainder.fits])
        signals = np.full_like(width, 3 // channels)
        counts = given.vertices, given.triangle_count, observations, signals, task.degrees, width
        warm_started = np.full_like(width, task.remainder is not None)
        sizes = np.tile(np.stack([*counts, warm_started, task.ends_early], axis=1), (channels, 1))
        arrays = _of_domains(given, channels)
        return cls._of_arrays(sizes, np.zeros(len(sizes)), arrays, warm, settings)

    @classmethod
    def of(cls, problems: list[Problem], settings: Settings) -> Prepared:
        """Prepare problems for a run with these resolved settings."""
        sizes = np.array([_sizes(problem, settings) for problem in problems], dtype=np.int64)
        noise = np.array([problem.noise for problem in problems])
        arrays = [
            _together([problem.domain for problem in problems], np.float64),
            _together([problem.triangles for problem in problems], np.int64),
            _together([problem.signals for problem in problems], np.float64),
            _together([problem.corners for problem in problems], np.int64),
            _together([problem.shares for problem in problems], np.float64),
            _together([problem.values for problem in problems], np.float64),
            _together([problem.weights for problem in problems], np.float64),
        ]
        return cls._of_arrays(sizes, noise, arrays, [problem.warm for problem in problems], settings)

    @classmethod
    def _of_arrays(
        cls,
        sizes: Indices,
        noise: Array,
        arrays: list[NDArray[Any]],
        warm: Sequence[WarmStart | None],
        settings: Settings,
    ) -> Prepared:
        """Lay out problems of these `_sizes`, (n, 8), whose arrays stand one after the other."""
        m, t, observations, signals, _, width, warm_started, _ = sizes.T
        steps = np.where(warm_started, 0, max(settings.iterations, 1))
        own = (2 * m, 3 * t, m * signals, 3 * observations, 3 * observations, observations * signals, observations)
        kept = steps * m * signals if settings.keep_iterations else 0 * m
        room = (0 * m + FRAME_SIZE, 2 * m, 2 * m, signals * width, signals * width, observations * signals)
        lengths = np.stack((*own, *room, steps, steps, kept))
        ends = np.cumsum(lengths, axis=1)
        found = [np.zeros(end, np.int64 if k == SUPPORT else np.float64) for k, end in enumerate(ends[len(own) :, -1])]
        addresses = np.array([array.ctypes.data for array in (*arrays, *found)])
        natives = np.empty((len(sizes), COUNTS + 1 + len(lengths)), dtype=np.int64)
        natives[:, :COUNTS] = sizes
        natives.view(np.float64)[:, COUNTS] = noise
        natives[:, COUNTS + 1 :] = (addresses[:, None] + NUMBER_SIZE * (ends - lengths)).T
        natives[kept == 0, -1] = 0
        slots = zip(found, (ends - lengths)[len(own) :].tolist(), ends[len(own) :].tolist(), strict=True)
        pieces = [[array[a:b] for a, b in zip(*places, strict=True)] for array, *places in slots]
        each = zip(signals.tolist(), warm, *pieces, strict=True)
        return cls(natives, arrays, [_room(*own) for own in each])


def _of_domains(given: Gathered, channels: int) -> list[NDArray[Any]]:
    """Flat arrays of the problems of all patches' first domains, then of those of the next ones."""
    if channels == 1:
        return [np.ravel(own) for own in given[3:]]
    domain, triangles, signals, corners, shares, values, weights = given[3:]
    at_vertices, observed = np.ravel(signals.T), np.ravel(values.T)
    alike = [np.tile(np.ravel(own), channels) for own in (domain, triangles, corners, shares, weights)]
    return [*alike[:2], at_vertices, *alike[2:4], observed, alike[4]]


def _together(arrays: list[NDArray[Any]], dtype: type[np.generic]) -> NDArray[Any]:
    """Arrays one after the other, flat."""
    return np.concatenate([array.ravel() for array in arrays], dtype=dtype, casting="same_kind")


def _room(
    signals: int,
    warm: WarmStart | None,
    frame: Array,
    start: Array,
    solved: Array,
    support: Indices,
    coefficients: Array,
    fitted: Array,
    energy: Array,
    squared_error: Array,
    history: Array,
) -> _Solved:
    """Shape the room for the solution of a problem; where it was solved before, with that solution to begin from."""
    if warm is not None:
        frame[:] = _as_numbers(warm.frame)
        solved[:] = warm.domain.ravel()
        support[:] = warm.support.ravel()
    return _Solved(
        frame,
        start.reshape(-1, 2),
        solved.reshape(-1, 2),
        support.reshape(signals, -1),
        coefficients.reshape(signals, -1),
        fitted.reshape(-1, signals),
        energy,
        squared_error,
        history.reshape(len(energy), -1, signals) if len(history) else None,
    )


def _patch_fit(solved: list[_Solved]) -> PatchFit:
    """The solved problems of one patch together."""
    signals = len(solved[0].support)
    if len(solved) == 1:  # common domains: nothing is to be put together
        own = solved[0]
        frames, domains = [_as_frame(own.frame, signals)], (own.start[None], own.solved[None])
        fit = PatchFit(frames, *domains, own.support, own.coefficients, own.fitted, own.energy, own.squared_error)
        return fit if own.history is None else replace(fit, history=own.history)
    histories = [own.history for own in solved if own.history is not None]
    return PatchFit(
        [_as_frame(own.frame, signals) for own in solved],
        np.stack([own.start for own in solved]),
        np.stack([own.solved for own in solved]),
        np.concatenate([own.support for own in solved]),
        np.concatenate([own.coefficients for own in solved]),
        np.concatenate([own.fitted for own in solved], axis=1),
        np.array([own.energy for own in solved]).sum(axis=0),
        np.array([own.squared_error for own in solved]).sum(axis=0),
        np.concatenate(histories, axis=2) if histories else None,
    )

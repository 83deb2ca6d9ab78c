"""Fitting the problems of a chunk by the compiled kernel: arrays in, the fits of `chunks` out."""

from __future__ import annotations

from ctypes import byref
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..native.library import NativeProblem, NativeSettings, function, reason_for_numpy
from ..settings import Settings
from . import chunks as by_numpy
from .batch import Frame, Problem
from .chunks import ChunkTask, PatchFit
from .methods.variable_projection import rigidity_decay

DONE, OUT_OF_MEMORY = 0, 1
"""Of `Status` in kernel.h; anything else means that the arrays contradict each other."""

FRAME_SIZE = 10
"""Numbers of a frame: centre, turn, origin, scale."""


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

    @classmethod
    def of(cls, problem: Problem, settings: Settings) -> _Solved:
        """Room for the solution of a problem; where it was solved before, with that solution to begin from."""
        size, signals = problem.signals.shape
        warm = problem.warm
        steps = max(settings.iterations, 1) if warm is None else 0
        width = _places(problem, settings) if warm is None else warm.support.shape[1]
        return cls(
            np.zeros(FRAME_SIZE) if warm is None else _as_numbers(warm.frame),
            np.empty((size, 2)),
            np.empty((size, 2)) if warm is None else warm.domain.copy(),
            np.empty((signals, width), dtype=np.int64) if warm is None else warm.support.astype(np.int64),
            np.empty((signals, width)),
            np.empty((len(problem.values), signals)),
            np.zeros(steps),
            np.zeros(steps),
            np.empty((steps, size, signals)) if settings.keep_iterations and warm is None else None,
        )


def _places(problem: Problem, settings: Settings) -> int:
    """How many functions a signal can use: no more than there are observations, beyond which all depend on others."""
    return min(settings.sparsity, (problem.degree + 1) * (problem.degree + 2) // 2, len(problem.values))


def _as_numbers(frame: Frame) -> Array:
    origin = np.zeros(3)
    origin[: len(frame.origin)] = frame.origin
    return np.concatenate([frame.centre, frame.turn.ravel(), origin, [frame.scale]])


def _as_frame(numbers: Array, signals: int) -> Frame:
    turn = numbers[2:6].reshape(2, 2).copy()
    return Frame(numbers[:2].copy(), turn, numbers[6 : 6 + signals].copy(), float(numbers[9]))


def fit_chunk(task: ChunkTask) -> list[PatchFit]:
    """Fit the patches of a chunk on this thread, by the compiled kernel or by NumPy.

    Raises
    ------
    MemoryError
        When it does not suffice, with a sentence that says so.
    """
    return fit_natively(task) if reason_for_numpy(task.settings) is None else by_numpy.fit_chunk(task)


def fit_natively(task: ChunkTask, instructions: str | None = None) -> list[PatchFit]:
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
        prepared = [Prepared.of(problem, task.settings) for problem in task.problems]
        natives = (NativeProblem * len(prepared))(*(one.native for one in prepared))
        status = fit_problems(natives, len(natives), byref(native_settings(task.settings)))
    except MemoryError:
        status = OUT_OF_MEMORY
    check(status, task.problems)
    each = len(prepared) // len(task.patches)
    return [_patch_fit([one.solved for one in prepared[k : k + each]]) for k in range(0, len(prepared), each)]


def check(status: int, problems: list[Problem]) -> None:
    """Raise what a status of the kernel means."""
    if status == OUT_OF_MEMORY:
        size = max(len(problem.domain) for problem in problems)
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
    """A problem as the kernel takes it.

    Attributes
    ----------
    native
        Sizes and addresses.
    inputs
        The arrays that it points at and reads: they have to live until the kernel returns.
    solved
        The arrays that it fills in.
    """

    native: NativeProblem
    inputs: list[NDArray[Any]]
    solved: _Solved

    @classmethod
    def of(cls, problem: Problem, settings: Settings) -> Prepared:
        """Prepare a problem for a run with these resolved settings."""
        solved = _Solved.of(problem, settings)
        inputs = [
            np.ascontiguousarray(problem.domain),
            np.ascontiguousarray(problem.triangles, dtype=np.int64),
            np.ascontiguousarray(problem.signals),
            np.ascontiguousarray(problem.corners, dtype=np.int64),
            np.ascontiguousarray(problem.shares),
            np.ascontiguousarray(problem.values),
            np.ascontiguousarray(problem.weights),
        ]
        native = NativeProblem(
            len(problem.domain),
            len(problem.triangles),
            len(problem.values),
            problem.signals.shape[1],
            problem.degree,
            solved.support.shape[1],
            problem.warm is not None,
            problem.ends_early,
            problem.noise,
            *(None if array is None else array.ctypes.data for array in (*inputs, *vars(solved).values())),
        )
        return cls(native, inputs, solved)


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

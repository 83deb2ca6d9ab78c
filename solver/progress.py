"""How a long computation reports its progress.

A long computation is a generator that yields `Progress` and returns its result.  Its caller (a blocking call, a modal
operator, a worker process) decides how to show the progress; closing the generator cancels the work.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from .arrays import Array

Result = TypeVar("Result")

FINISH = "finish"
"""Send this to the generator to stop refining and get the best result so far."""


@dataclass(frozen=True)
class Progress:
    """One step of a long computation.

    Attributes
    ----------
    stage
        Name of the stage, ready to be shown ("Solving patches").
    fraction
        Share of the whole work that is done, in [0, 1], never falling.
    detail
        A short addition such as "96 of 535 patches"; may be empty.
    surface
        Computes `vertices`, where the stage has a surface to show; call it before the work continues.
    """

    stage: str
    fraction: float
    detail: str = ""
    surface: Callable[[], Array] | None = None

    @property
    def vertices(self) -> Array | None:
        """The current surface, (V, 3) in scene units, or None; computed on access."""
        return None if self.surface is None else self.surface()


Steps = Generator[Progress, str | None, Result]
"""A long computation: yields `Progress`, takes `None` (continue) or `FINISH`, and returns its result."""


def run_to_end(steps: Steps[Result], report: Callable[[Progress], str | None] | None = None) -> Result:
    """Run a computation to its end and return its result.

    Parameters
    ----------
    steps
        What one of the `..._steps` functions returned.
    report
        Called with each `Progress`.  It returns `None` to continue, or `FINISH` to end early with the best result so
        far; an exception that it raises (for example `Cancelled`) cancels the computation and reaches the caller.

    Examples
    --------
    >>> from sparse_surface.solver import FINISH, approximate_steps, run_to_end
    >>> steps = approximate_steps(vertices, faces)
    >>> result = run_to_end(steps, lambda step: FINISH if step.fraction > 0.5 else None)
    """
    request: str | None = None
    try:
        while True:
            try:
                step = steps.send(request)
            except StopIteration as end:
                return end.value
            request = report(step) if report is not None else None
    finally:
        steps.close()


def relayed(
    steps: Steps[Result],
    shown: Callable[[Progress], Progress] = lambda step: step,
    around: Callable[[], AbstractContextManager[Any]] = nullcontext,
) -> Steps[Result]:
    """Yield the `shown` form of each `Progress` of a sub-computation, each step run in the context that `around` makes.

    Requests pass through.
    """
    request: str | None = None
    try:
        while True:
            try:
                with around():
                    step = steps.send(request)
            except StopIteration as end:
                return end.value
            request = yield shown(step)
    finally:
        steps.close()


def within(steps: Steps[Result], start: float, end: float) -> Steps[Result]:
    """Map the fractions of a sub-computation to [start, end] of the whole; requests pass through."""
    return relayed(steps, lambda step: replace(step, fraction=start + (end - start) * step.fraction))

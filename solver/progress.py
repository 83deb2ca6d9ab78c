"""What a long computation tells while it runs.

Long work is one generator: it yields `Progress` and returns its result.  Whoever pumps it (a blocking
call, a modal operator, a worker process) decides how to show it; closing the generator cancels the work.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Result = TypeVar("Result")


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
    vertices
        The surface as it stands, (V, 3) in scene units, where the stage has one to show.
    """

    stage: str
    fraction: float
    detail: str = ""
    vertices: NDArray[np.float64] | None = None


Steps = Generator[Progress, None, Result]


def run_to_end(steps: Steps[Result], report: Callable[[Progress], None] | None = None) -> Result:
    """Pump `steps` to its end and return its result, handing each `Progress` to `report`.

    An exception that `report` raises (for example `Cancelled`) closes the work and passes through.
    """
    try:
        while True:
            try:
                step = next(steps)
            except StopIteration as end:
                return end.value  # type: ignore[no-any-return]
            if report is not None:
                report(step)
    finally:
        steps.close()


def within(steps: Steps[Result], start: float, end: float) -> Steps[Result]:
    """Squeeze the fractions of a sub-computation into [start, end] of the whole."""
    while True:
        try:
            step = next(steps)
        except StopIteration as stop:
            return stop.value  # type: ignore[no-any-return]
        yield Progress(step.stage, start + (end - start) * step.fraction, step.detail, step.vertices)

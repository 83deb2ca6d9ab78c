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

FINISH = "finish"
"""Sent into the work to say: stop refining and return the best result so far."""


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
        Makes `vertices`, where the stage has a surface to show; to be called before the work goes on.
    """

    stage: str
    fraction: float
    detail: str = ""
    surface: Callable[[], NDArray[np.float64]] | None = None

    @property
    def vertices(self) -> NDArray[np.float64] | None:
        """The surface as it stands, (V, 3) in scene units, or None; who does not ask pays nothing."""
        return None if self.surface is None else self.surface()


Steps = Generator[Progress, str | None, Result]
"""Long work: yields `Progress`, takes `None` (go on) or `FINISH`, returns its result."""


def run_to_end(steps: Steps[Result], report: Callable[[Progress], str | None] | None = None) -> Result:
    """Pump `steps` to its end and return its result, handing each `Progress` to `report`.

    What `report` returns is sent into the work: `None` to go on, `FINISH` to end it early with the best
    result so far.  An exception that `report` raises (for example `Cancelled`) closes the work and passes
    through.
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


def within(steps: Steps[Result], start: float, end: float) -> Steps[Result]:
    """Squeeze the fractions of a sub-computation into [start, end] of the whole; requests pass through."""
    request: str | None = None
    try:
        while True:
            try:
                step = steps.send(request)
            except StopIteration as stop:
                return stop.value
            request = yield Progress(step.stage, start + (end - start) * step.fraction, step.detail, step.surface)
    finally:
        steps.close()

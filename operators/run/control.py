"""A run in the background: a child process for each object in turn."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

import bpy
from bpy.types import Context, Timer

from ...solver.settings import Settings

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ...solver.job import Job
    from ...solver.progress import Progress
    from ..data.meshes import Source
    from ..data.points import CloudSource


class Preview(Protocol):
    """What shows the surface while it is being solved.

    Its budget: one preview blocks Blender's window for at most 150 ms, and all previews together for at most a
    twentieth of the time; `tests/window/test_responsiveness.py` measures the first.
    """

    def take(self, source: Source, positions: NDArray[np.float64]) -> None:
        """Remember the newest surface, positions (V, 3) in the frame of `source.arrays`."""

    def update(self, context: Context) -> bool:
        """Show the newest surface unless the rest period is running; return whether anything was shown."""

    def clear(self) -> None:
        """Remove everything that is shown."""


@dataclass
class Run:
    """The objects of one press of the button.

    Attributes
    ----------
    tasks
        What to approximate, in this order, and with which settings.
    results
        What is solved, with its source.
    refusals
        One sentence for each object that has no result.
    progress
        The solver's last message, its fraction that of the whole run.
    started
        When the solver first reported; until then, when the run began.
    shown, shown_at
        The workspace and the line of progress that is drawn there, and since when.
    sidebars_behind
        Whether the sidebars still show the previous line.
    preview
        What shows the surface while it is solved; None where that is not wanted.
    """

    tasks: list[tuple[Source | CloudSource, Settings]]
    preview: Preview | None = None
    results: list[tuple[Any, Any]] = field(default_factory=list)
    refusals: list[str] = field(default_factory=list)
    progress: Progress | None = None
    finishing: bool = False
    waiting: bool = False
    timer: Timer | None = None
    started: float = field(default_factory=time.monotonic)
    shown: tuple[str, str] = ("", "")
    shown_at: float = 0.0
    sidebars_behind: bool = False
    _begun: int = 0
    _job: Job | None = None

    @property
    def done(self) -> bool:
        """Whether nothing is left to be solved."""
        return self._job is None and self._begun == len(self.tasks)

    @property
    def current_source(self) -> Source | CloudSource | None:
        """The object that is being solved."""
        return self.tasks[self._begun - 1][0] if self._job is not None else None

    def advance(self) -> Progress | None:
        """Take what the child reports, start the next one when it is done; return new progress, if any."""
        if self._job is None and self._begun < len(self.tasks):
            self._start_next()
        if self._job is None:
            return None
        said = self._job.poll()
        if said is not None:
            if self.progress is None:
                self.started = time.monotonic()
            before = (self._begun - 1) / len(self.tasks)
            said = self.progress = replace(said, fraction=before + said.fraction / len(self.tasks))
        if not self._job.running:
            self._take_result(self._job)
        return said

    def finish(self) -> None:
        """Keep the best result so far: end the current object early and start no other."""
        self.finishing = True
        del self.tasks[self._begun :]
        if self._job is not None:
            self._job.finish()

    def stop(self) -> None:
        """End the child and forget every result."""
        job, self._job = self._job, None
        if job is not None:
            job.stop()

    def remaining_seconds(self) -> float | None:
        """Return how long the rest takes at the speed so far, once that is known."""
        passed = time.monotonic() - self.started
        if self.progress is None or self.progress.fraction < 0.02 or passed < 1.0:
            return None
        return passed * (1.0 - self.progress.fraction) / self.progress.fraction

    def _start_next(self) -> None:
        from ...solver.job import Job

        source, settings = self.tasks[self._begun]
        self._begun += 1
        self._job = Job((sys.executable, *bpy.app.python_args))
        self._job.start(source.arrays, settings, previews=self.preview is not None)

    def _take_result(self, job: Job) -> None:
        source = self.tasks[self._begun - 1][0]
        if job.outcome is not None:
            self.results.append((source, job.outcome))
        else:
            self.refusals.append(f"'{source.name}': {job.failure}")
        self.stop()

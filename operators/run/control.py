"""The work that runs in the background: one run at a time, a child process for each object in turn.

`stop` may be called from anywhere, as often as one likes: by Cancel and ESC, before another file is loaded,
when the add-on is disabled, when Blender quits and when something fails.
"""

from __future__ import annotations

import atexit
import sys
import time
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Timer

from ...solver.settings import Settings
from .status import redraw_progress, settle_sidebars, show_status

if TYPE_CHECKING:
    from ...solver.approximation.result import Approximation
    from ...solver.interchange import CloudOutcome
    from ...solver.job import Job
    from ...solver.progress import Progress
    from ..data.meshes import Source
    from ..data.points import CloudSource
    from ..preview.controller import LivePreview


@dataclass
class Run:
    """The objects of one press of the button.

    Attributes
    ----------
    tasks
        What is approximated, in this order, and how.
    results
        What is done, with its source.
    refusals
        One sentence for each object that has no result.
    progress
        What the solver said last, its fraction that of the whole run.
    started
        When the solver said its first word; until then, when the run began.
    shown, shown_at
        The workspace and the line of progress that is drawn there, and since when.
    sidebars_behind
        Whether the sidebars still show the line before.
    preview
        What shows the surface while it is solved; None where that is not wanted.
    """

    tasks: list[tuple[Source | CloudSource, Settings]]
    preview: LivePreview | None = None
    results: list[tuple[Source | CloudSource, Approximation | CloudOutcome]] = field(default_factory=list)
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
        """Take in what the child says, start the next one where it is done; return new progress, if any."""
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
        """Keep the best result so far: end the current object early and begin no other."""
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
        """Return how long the rest takes at the speed so far, once that can be said."""
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


current: Run | None = None
"""The run that has the solver to itself, or None."""

notice = ""
"""Why the last run ended, where its operator could not say so itself."""


def start(run: Run) -> None:
    """Make a run the current one; there must be none."""
    global current, notice
    assert current is None
    current, notice = run, ""


def stop(reason: str = "") -> None:
    """End the current run, if there is one, and take back all that it shows."""
    global current, notice
    run, current = current, None
    if run is None:
        return
    run.stop()
    notice = reason
    if reason:
        print(reason)
    if run.preview is not None:
        run.preview.clear()
    manager = bpy.context.window_manager
    if run.timer is not None:
        manager.event_timer_remove(run.timer)
    show_status(bpy.context, None)
    redraw_progress(bpy.context)
    settle_sidebars()


@bpy.app.handlers.persistent
def _stop_before_load(*_: object) -> None:
    stop(rpt_("The approximation was cancelled because another file was loaded"))


def _kill_at_exit() -> None:
    if current is not None:
        current.stop()


def register() -> None:
    """Have every end of the session, or of this file in it, end the run too."""
    bpy.app.handlers.load_pre.append(_stop_before_load)
    atexit.register(_kill_at_exit)


def unregister() -> None:
    """End the run; nothing calls into this module any more."""
    stop()
    atexit.unregister(_kill_at_exit)
    bpy.app.handlers.load_pre.remove(_stop_before_load)

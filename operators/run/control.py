"""A run in the background: a child process for each object in turn."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Timer

from ...solver.settings import Settings
from ..data.objects import current_name, parts_of
from .preloading import python_command
from .watch import Watch

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ...solver.job import Job
    from ...solver.progress import Progress
    from ..data.meshes import Source
    from ..data.points import CloudSource


WITHOUT_SURFACE = {
    "Reading the mesh",
    "Parameterising patches",
    "Making the base",
    "Looking at the points",
    "Fitting the base",
    "Choosing the patches",
}
"""Stages of the progress that have no surface yet which could be kept."""


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


@dataclass(eq=False, repr=False)
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
    dropped
        One sentence for each object that was deleted or edited meanwhile.
    progress
        The solver's last message, its fraction that of the whole run.
    started
        When the solver first reported; until then, when the run began.
    shown, shown_at
        The workspace and the line of progress that is drawn there, and since when; at first, when the run began.
    sidebars_behind
        Whether the sidebars still show the previous line.
    preview
        What shows the surface while it is solved; None where that is not wanted.
    """

    tasks: list[tuple[Source | CloudSource, Settings]]
    preview: Preview | None = None
    results: list[tuple[Any, Any]] = field(default_factory=list)
    refusals: list[str] = field(default_factory=list)
    dropped: list[str] = field(default_factory=list)
    progress: Progress | None = None
    finishing: bool = False
    waiting: bool = False
    timer: Timer | None = None
    started: float = field(default_factory=time.monotonic)
    shown: tuple[str, str] = ("", "")
    shown_at: float = field(default_factory=time.monotonic)
    sidebars_behind: bool = False
    _begun: int = 0
    _job: Job | None = None
    _watch: Watch = field(init=False)

    def __post_init__(self) -> None:
        self._watch = Watch(part for source, _ in self.tasks for part in parts_of(source))

    @property
    def done(self) -> bool:
        """Whether nothing is left to be solved."""
        return self._job is None and self._begun == len(self.tasks)

    @property
    def current_source(self) -> Source | CloudSource | None:
        """The object that is being solved."""
        return self.tasks[self._begun - 1][0] if self._job is not None else None

    def advance(self) -> Progress | None:
        """Take what the child reports, start the next one when it is done; return new progress, if any.

        What was deleted or edited since it was read is dropped.
        """
        for session_uid, sentence in self._watch.lost().items():
            self.dropped += [sentence, *self._drop(session_uid)]
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

    @property
    def has_surface(self) -> bool:
        """Whether the current object has a surface already."""
        return self.progress is not None and self.progress.stage not in WITHOUT_SURFACE

    @property
    def can_finish(self) -> bool:
        """Whether there is anything to be kept: a surface that is being refined, or a result."""
        return not (self.finishing or self.done) and (self.has_surface or bool(self.results))

    def finish(self) -> None:
        """Keep the best result so far: end the current object early and start no other.

        An object without any surface yet is left out.
        """
        self.finishing = True
        del self.tasks[self._begun :]
        if self._job is not None and self.has_surface:
            self._job.finish()
        else:
            self.stop()

    def stop(self) -> None:
        """End the child; the object that it works on gets no result."""
        job, self._job = self._job, None
        if job is not None:
            job.stop()

    def _drop(self, session_uid: int) -> list[str]:
        """Forget the tasks and results of an object, and end the child if it works on that.

        Returns a sentence about what was read as one with it, if there is such.
        """

        def of_others(source: Any) -> bool:
            return session_uid not in {part.session_uid for part in parts_of(source)}

        known = [source for source, _ in (*self.results, *self.tasks[max(self._begun - 1, 0) :])]
        lost = {part.session_uid: part for source in known if not of_others(source) for part in parts_of(source)}
        lost.pop(session_uid, None)
        if self.current_source is not None and not of_others(self.current_source):
            self.stop()
        self.tasks[self._begun :] = [task for task in self.tasks[self._begun :] if of_others(task[0])]
        self.results = [each for each in self.results if of_others(each[0])]
        text = rpt_("So there is none of what was solved together with it: {}")
        return [text.format(", ".join(map(current_name, lost.values())))] if lost else []

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
        if self.progress is not None:
            self.progress = replace(self.progress, stage="Reading the mesh", detail="")
        self._job = Job(python_command())
        self._job.start(source.arrays, settings, previews=self.preview is not None)

    def _take_result(self, job: Job) -> None:
        source, settings = self.tasks[self._begun - 1]
        if job.outcome is not None:
            self.results.append((source, job.outcome))
        elif len(parts_of(source)) > 1:  # one of them may be to blame
            self.tasks[self._begun : self._begun] = [(part, settings) for part in parts_of(source)]
        else:
            self.refusals.append(f"'{current_name(source)}': {job.failure}")
        self.stop()

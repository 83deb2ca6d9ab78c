"""What operators that run the solver share: in this process for scripts, in a child process with a window."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Event, Object

from ...solver.errors import SparseSurfaceError
from ...solver.settings import Settings
from ..data.lengths import length_text
from ..data.objects import current_name, parts_of, select_only, source_to_solve
from ..data.report_text import one_line
from ..data.visibility import readable, settle
from ..representation import compacting
from . import estimate
from .control import Preview, Run
from .preferences import preferred_workers
from .preloading import python_command
from .session import session
from .status import show_progress

# NumPy-heavy modules are imported inside functions: enabling the add-on loads this module.
if TYPE_CHECKING:
    from ...solver.progress import Progress
    from ..data.meshes import Source
    from ..data.parts import Parts
    from ..data.points import CloudSource

Task = tuple[Any, Any]
"""What is read from objects, a `Source`, `Parts`, a `CloudSource` or a `PairSource`, and the settings."""

Solved = tuple[Any, Any]
"""A `Source` or `Parts` with an `Approximation`, a `CloudSource` with its `CloudOutcome`, a `PairSource` with its
`Distances`."""


class SolverOperator:
    """Runs the solver for an operator, which says on what (`tasks`) and makes objects of the results (`make_objects`).

    Raises
    ------
    TypeError
        When a subclass is defined without these two methods.
    """

    _run: Run | None = None
    has_preview = True
    """Whether the surface can be shown while it is solved."""

    if TYPE_CHECKING:
        options: Any
        report: Any

    def __init_subclass__(cls, **others: Any) -> None:
        super().__init_subclass__(**others)
        for name in ("tasks", "make_objects"):
            if getattr(cls, name) is getattr(SolverOperator, name):
                raise TypeError(f"{cls.__name__} has no method '{name}'")

    @abstractmethod
    def tasks(self, context: Context) -> tuple[list[Task], list[str]]:
        """Return what to solve with which settings, and a sentence for each object that is refused."""

    @abstractmethod
    def make_objects(self, context: Context, done: Sequence[Solved], refusals: list[str]) -> list[Object]:
        """Make objects of the results; for each that becomes none, add a sentence to `refusals`."""

    def execute(self, context: Context) -> set[str]:
        """Solve in this process and return when all is done: for scripts and without a window."""
        tasks, refusals = self.tasks(context)
        done: list[Solved] = []
        begun = 0
        while begun < len(tasks):
            source, settings = tasks[begun]
            begun += 1
            try:
                done.append((source, _solve_here(source, settings, context, begun - 1, len(tasks))))
            except (SparseSurfaceError, MemoryError) as error:
                if len(parts_of(source)) > 1:  # one of them may be to blame
                    tasks[begun:begun] = [(part, settings) for part in parts_of(source)]
                else:
                    refusals.append(refusal(source.name, error, len(tasks)))
        return self._conclude(context, done, refusals)

    def invoke(self, context: Context, event: Event) -> set[str]:
        """Solve in a child process while Blender stays usable."""
        if bpy.app.background or not self.options.is_invoke:
            return self.execute(context)
        tasks, refusals = self.tasks(context)
        if not tasks:
            return self._conclude(context, [], refusals)
        self._run = Run(tasks, self._wanted_preview(context), refusals=refusals)
        session.start(self._run)
        self._run.advance()  # the redraw that the click asks for may take a third of a second
        self._run.timer = context.window_manager.event_timer_add(0.1, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def _wanted_preview(self, context: Context) -> Preview | None:
        settings = context.scene.sparse_surface
        if not (self.has_preview and settings.show_preview):
            return None
        from ..preview.controller import LivePreview

        return LivePreview(settings.preview_kind)

    def modal(self, context: Context, event: Event) -> set[str]:
        run = self._run
        if run is not None and session.current is run and means_to_cancel(context, event):
            session.stop()
        if run is None or session.current is not run:
            self.report({"INFO"}, rpt_("Approximation cancelled"))
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            return self._step(context, run)
        except BaseException:
            session.stop(rpt_("The approximation failed; the console says why"))
            raise

    def cancel(self, context: Context) -> None:
        """End the run; Blender calls this when the window closes."""
        if self._run is not None and session.current is self._run:
            session.stop()

    def _step(self, context: Context, run: Run) -> set[str]:
        previewed = self._preview(context, run, run.advance())
        # Undo would lose an object that is made outside of Object Mode.
        run.waiting = run.done and bool(run.results) and context.mode != "OBJECT"
        if not run.done or run.waiting:
            if not previewed:  # both in one redraw would block the window for longer
                show_progress(context, run)
            return {"PASS_THROUGH"}
        session.stop("\n".join(run.dropped))
        for sentence in run.dropped:
            self.report({"WARNING"}, sentence)
        return self._conclude(context, run.results, run.refusals)

    @staticmethod
    def _preview(context: Context, run: Run, said: Progress | None) -> bool:
        """Show the current surface when a preview is due; return whether it was shown."""
        if run.preview is None:
            return False
        source: Any = run.current_source  # only meshes have previews
        if said is not None and said.vertices is not None and source is not None:
            run.preview.take(source, said.vertices)
        return run.preview.update(context)

    def _conclude(self, context: Context, done: Sequence[Solved], refusals: list[str]) -> set[str]:
        """Make the objects and report on each; if none is made, that is an error."""
        made = self.make_objects(context, done, refusals)
        for refused in refusals:
            self.report({"WARNING"} if made else {"ERROR"}, refused)
        if not made:
            return {"CANCELLED"}
        select_only(context, made)
        if not bpy.app.background:
            compacting.begin(python_command())
        return {"FINISHED"}

    def make_each(
        self,
        make: Callable[[Any, Any], list[Object]],
        context: Context,
        done: Sequence[Solved],
        refusals: list[str],
        others: Sequence[Object] = (),
    ) -> list[Object]:
        """Make objects of each result by `make(source, result)`, shown instead of their sources and `others`."""
        made: list[Object] = []
        for source, result in done:
            try:
                found = make(source, result)
            except SparseSurfaceError as error:
                refusals.append(str(error))
                continue
            if not found:
                continue
            settle(found, context, others)
            self.say_result(current_name(source), result.report)
            made += found
        return made

    def say_result(self, name: str, report: dict[str, Any]) -> None:
        """Report the result in one line, and remember how long it took."""
        self.report({"INFO"}, one_line(name, report, partial(length_text, bpy.context.scene, digits=3)))
        if not report.get("ended_early"):  # such a run tells nothing of whole ones
            estimate.learn(report)


def means_to_cancel(context: Context, event: Event) -> bool:
    """Whether a key is ESC and meant for the run: pressed over a 3D viewport, in Object Mode, with nothing to stop.

    Tools, menus and text fields take their own ESC before it comes here.
    """
    if (event.type, event.value) != ("ESC", "PRESS") or context.mode != "OBJECT":
        return False
    if any(window.screen.is_animation_playing for window in context.window_manager.windows):
        return False
    x, y = event.mouse_x, event.mouse_y
    return any(
        area.type == "VIEW_3D" and 0 <= x - area.x < area.width and 0 <= y - area.y < area.height
        for area in context.window.screen.areas
    )


def scene_settings(context: Context) -> Settings:
    """Return the solver's settings of the scene, with the number of workers of the preferences where it has none."""
    settings: Settings = context.scene.sparse_surface.to_settings()
    return replace(settings, workers=settings.workers or preferred_workers(context))


def read_sources(
    context: Context, chosen: Sequence[Object], together: Settings | None = None
) -> tuple[list[Source | Parts], list[str]]:
    """Read objects, or the sources of results, as the scene asks; also return a sentence for each that is refused.

    With the settings that they are to be solved with, those that are parts of one surface are read `together`.
    """
    from ..data.parts import read_together

    settings = context.scene.sparse_surface
    how = {"evaluated": settings.use_modifiers, "vertex_group": settings.vertex_group}
    gone = rpt_("What '{}' was made from is gone. Press Use as Source to approximate it as it is.")
    found = {candidate: source_to_solve(candidate) for candidate in chosen}
    refusals = [gone.format(candidate.name) for candidate, source in found.items() if source is None]
    wanted = list(dict.fromkeys(source for source in found.values() if source is not None))
    with readable(wanted, context):
        sources, refused = read_together(wanted, context.evaluated_depsgraph_get(), together, **how)
    return sources, refusals + [refusal(name, error, len(chosen)) for name, error in refused]


def refusal(name: str, error: BaseException, count: int) -> str:
    """Return the sentence about an object that is refused; it is named if there are several."""
    text = str(error) or rpt_("There is not enough memory for this mesh.")
    return text if count == 1 else f"'{name}': {text}"


def _solve_here(
    source: Source | Parts | CloudSource, settings: Settings, context: Context, number: int, count: int
) -> Any:
    from ...solver.job import solve_here

    manager = context.window_manager
    manager.progress_begin(0.0, count)

    def show(step: Progress) -> None:
        manager.progress_update(number + step.fraction)

    try:
        return solve_here(source.arrays, settings, show)
    finally:
        manager.progress_end()

"""What operators that solve have in common: in this process for scripts, in a child process with a window."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Event, Object

from ...solver.errors import SparseSurfaceError
from ...solver.settings import Settings
from . import control as running
from . import estimate
from .preferences import preferred_workers
from .status import show_progress

if TYPE_CHECKING:
    from ...solver.progress import Progress
    from ..data.meshes import Source
    from ..data.points import CloudSource
    from ..preview.controller import LivePreview

Task = tuple[Any, Settings]
"""What is read from an object, a `Source` or a `CloudSource`, and the settings."""

Solved = tuple[Any, Any]
"""A `Source` with its `Result`, or a `CloudSource` with its `CloudOutcome`."""


class Solving:
    """What an operator that solves does; a subclass says on what (`tasks`) and makes objects of it (`make_objects`)."""

    _run: running.Run | None = None
    has_preview = True
    """Whether the surface can be shown while it is solved."""

    if TYPE_CHECKING:
        options: Any
        report: Any

    @abstractmethod
    def tasks(self, context: Context) -> tuple[list[Task], list[str]]:
        """Return what to solve with which settings, and a sentence for each object that is refused."""

    @abstractmethod
    def make_objects(self, context: Context, done: Sequence[Solved], refusals: list[str]) -> list[Object]:
        """Make objects of what is solved; what becomes none has its sentence added to `refusals`."""

    def execute(self, context: Context) -> set[str]:
        """Solve in this process and return when all is done: for scripts and without a window."""
        tasks, refusals = self.tasks(context)
        done: list[Solved] = []
        for number, (source, settings) in enumerate(tasks):
            try:
                done.append((source, _solve_here(source, settings, context, number, len(tasks))))
            except (SparseSurfaceError, MemoryError) as error:
                refusals.append(refusal(source.name, error, len(tasks)))
        return self._conclude(context, done, refusals)

    def invoke(self, context: Context, event: Event) -> set[str]:
        """Solve in a child process while Blender goes on."""
        if bpy.app.background or not self.options.is_invoke:
            return self.execute(context)
        tasks, refusals = self.tasks(context)
        if not tasks:
            return self._conclude(context, [], refusals)
        self._run = running.Run(tasks, self._wanted_preview(context), refusals=refusals)
        running.start(self._run)
        self._run.timer = context.window_manager.event_timer_add(0.1, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def _wanted_preview(self, context: Context) -> LivePreview | None:
        settings = context.scene.sparse_surface
        if not (self.has_preview and settings.show_preview):
            return None
        from ..preview.controller import LivePreview

        return LivePreview(settings.preview_kind)

    def modal(self, context: Context, event: Event) -> set[str]:
        run = self._run
        if run is not None and running.current is run and event.type == "ESC" and event.value == "PRESS":
            running.stop()
        if run is None or running.current is not run:
            self.report({"INFO"}, rpt_("Approximation cancelled"))
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            return self._step(context, run)
        except BaseException:
            running.stop(rpt_("The approximation failed; the console says why"))
            raise

    def cancel(self, context: Context) -> None:
        """End the run; Blender calls this when the window closes."""
        if self._run is not None and running.current is self._run:
            running.stop()

    def _step(self, context: Context, run: running.Run) -> set[str]:
        previewed = self._preview(context, run, run.advance())
        # An object that is made outside of Object Mode would be lost to undo.
        run.waiting = run.done and context.mode != "OBJECT"
        if not run.done or run.waiting:
            if not previewed:  # both in one picture would hold the window up for longer
                show_progress(context, run)
            return {"PASS_THROUGH"}
        running.stop()
        return self._conclude(context, run.results, run.refusals)

    @staticmethod
    def _preview(context: Context, run: running.Run, said: Progress | None) -> bool:
        """Show the surface as it stands, where it is time for it; whether that was done."""
        if run.preview is None:
            return False
        source: Any = run.current_source  # only meshes have previews
        if said is not None and said.vertices is not None and source is not None:
            run.preview.take(source, said.vertices)
        return run.preview.update(context)

    def _conclude(self, context: Context, done: Sequence[Solved], refusals: list[str]) -> set[str]:
        """Make the objects and say for each what came out; with nothing made it is an error."""
        made = self.make_objects(context, done, refusals)
        for refused in refusals:
            self.report({"WARNING"} if made else {"ERROR"}, refused)
        if not made:
            return {"CANCELLED"}
        from ..data import meshes as mesh_data

        mesh_data.select_only(context, made)
        return {"FINISHED"}

    def say_result(self, name: str, report: dict[str, Any]) -> None:
        """Say in one line what came out, and remember how long it took."""
        error, seconds = report["surface_error"], report["seconds"]["total"]
        if "denoise" in report and not report["patches"]:
            level, moved = report["denoise"]["noise_level"], report["denoise"]["displacement"]
            text = rpt_("'{}': noise of {:.3g} taken off, vertices moved by rms {:.3g}, max {:.3g}, {:.1f} s")
            line = text.format(name, level, moved["rms"], moved["max"], seconds)
            if not level:
                line = rpt_("'{}': no noise found, nothing was moved, {:.1f} s").format(name, seconds)
        else:
            text = rpt_("'{}': {} patches, surface error rms {:.3g}, max {:.3g}, {:.1f} s")
            line = text.format(name, report["patches"], error["rms"], error["max"], seconds)
        self.report({"INFO"}, line)
        estimate.learn(report)


def scene_settings(context: Context) -> Settings:
    """Return the solver's settings of the scene, with the number of workers that the preferences name."""
    settings: Settings = context.scene.sparse_surface.to_settings()
    return replace(settings, workers=settings.workers or preferred_workers(context))


def read_sources(context: Context, chosen: Sequence[Object]) -> tuple[list[Source], list[str]]:
    """Read objects as the scene's settings say; returns a sentence for each that is refused."""
    from ..data import meshes as mesh_data

    settings = context.scene.sparse_surface
    depsgraph = context.evaluated_depsgraph_get()
    sources, refusals = [], []
    for candidate in chosen:
        try:
            sources.append(
                mesh_data.read_object(
                    candidate, depsgraph, evaluated=settings.use_modifiers, vertex_group=settings.vertex_group
                )
            )
        except SparseSurfaceError as error:
            refusals.append(refusal(candidate.name, error, len(chosen)))
    return sources, refusals


def refusal(name: str, error: BaseException, count: int) -> str:
    """Return the sentence about an object that is refused; one of several is named."""
    text = str(error) or rpt_("There is not enough memory for this mesh.")
    return text if count == 1 else f"'{name}': {text}"


def _solve_here(source: Source | CloudSource, settings: Settings, context: Context, number: int, count: int) -> Any:
    from ...solver.job import solve_arrays
    from ...solver.progress import run_to_end

    manager = context.window_manager
    manager.progress_begin(0.0, count)

    def show(step: Progress) -> None:
        manager.progress_update(number + step.fraction)

    try:
        return run_to_end(solve_arrays(source.arrays, settings), show)
    finally:
        manager.progress_end()

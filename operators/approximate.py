"""The operator behind the button: selected meshes in, sparse surfaces out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Event, Object, Operator

from ..solver.errors import SparseSurfaceError
from ..solver.settings import Settings
from . import estimate, running
from .heat_map import colour_scale
from .preferences import preferred_workers
from .requirements import missing_packages
from .result_object import PREVIEW, remove_previews
from .status import redraw_progress, show_status

if TYPE_CHECKING:
    from ..solver.progress import Progress
    from .mesh_data import Result, Source


class SPARSE_SURFACE_OT_approximate(Operator):
    """Approximate each selected mesh by smooth patches that keep its sharp features. The result is a new object"""

    bl_idname = "sparse_surface.approximate"
    bl_label = "Approximate"
    bl_options = {"UNDO"}

    _run: running.Run | None = None
    _preview_uid = 0

    @classmethod
    def poll(cls, context: Context) -> bool:
        reason = reason_against(context)
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Context) -> set[str]:
        """Solve in this process and return when all is done: for scripts and without a window."""
        sources, refusals = self._read_sources(context)
        done: list[tuple[Source, Result]] = []
        for number, source in enumerate(sources):
            try:
                done.append((source, _solve_here(source, self._settings(context), context, number, len(sources))))
            except (SparseSurfaceError, MemoryError) as error:
                refusals.append(_refusal(source.name, error, len(sources)))
        return self._conclude(context, done, refusals)

    def invoke(self, context: Context, event: Event) -> set[str]:
        """Solve in a child process while Blender goes on."""
        if bpy.app.background or not self.options.is_invoke:
            return self.execute(context)
        sources, refusals = self._read_sources(context)
        if not sources:
            return self._conclude(context, [], refusals)
        self._run = running.Run(
            sources, self._settings(context), context.scene.sparse_surface.show_preview, refusals=refusals
        )
        running.start(self._run)
        self._run.timer = context.window_manager.event_timer_add(0.1, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

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
        said = run.advance()
        if said is not None and said.vertices is not None and run.current_source is not None:
            self._show_preview(context, run.current_source, said.vertices)
        # An object that is made outside of Object Mode would be lost to undo.
        run.waiting = run.done and context.mode != "OBJECT"
        if not run.done or run.waiting:
            show_status(context, run)
            redraw_progress(context)
            return {"PASS_THROUGH"}
        running.stop()
        return self._conclude(context, run.results, run.refusals)

    def _show_preview(self, context: Context, source: Source, positions: Any) -> None:
        from . import mesh_data

        preview = mesh_data.find_object(self._preview_uid)
        if preview is None or PREVIEW not in preview or preview[PREVIEW] != source.session_uid:
            remove_previews()
            preview = mesh_data.create_preview(context, source)
        if preview is not None:
            self._preview_uid = preview.session_uid
            mesh_data.update_preview(preview, source, positions, context.scene)

    def _settings(self, context: Context) -> Settings:
        settings: Settings = context.scene.sparse_surface.to_settings()
        return replace(settings, workers=settings.workers or preferred_workers(context))

    def _read_sources(self, context: Context) -> tuple[list[Source], list[str]]:
        from . import mesh_data

        settings = context.scene.sparse_surface
        chosen = selected_meshes(context) or list(context.selected_objects)[:1]
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
                refusals.append(_refusal(candidate.name, error, len(chosen)))
        return sources, refusals

    def _conclude(self, context: Context, done: Sequence[tuple[Source, Result]], refusals: list[str]) -> set[str]:
        """Make the result objects and say for each what came out; with nothing made it is an error."""
        made = []
        for source, result in done:
            try:
                made.append(_make_result(context, source, result))
            except SparseSurfaceError as error:
                refusals.append(str(error))
            else:
                self.report({"INFO"}, summary(source.name, result.report))
                estimate.learn(result.report)
        for refusal in refusals:
            self.report({"WARNING"} if made else {"ERROR"}, refusal)
        if not made:
            return {"CANCELLED"}
        from . import mesh_data

        mesh_data.select_only(context, made)
        return {"FINISHED"}


def reason_against(context: Context) -> str:
    """Return why the button cannot be pressed, or nothing."""
    if missing_packages():
        return rpt_("{} is missing: install the add-on's zip for your platform, which brings it").format(
            " and ".join(missing_packages())
        )
    if running.current is not None:
        return rpt_("An approximation is running; wait for it or cancel it")
    if context.mode != "OBJECT":
        return rpt_("Switch to Object Mode first")
    if not context.selected_objects:
        return rpt_("Select a mesh")
    if not selected_meshes(context):
        return rpt_("The selected object is not a mesh; convert it first (Object > Convert > Mesh)")
    if not any(chosen.data.polygons or chosen.modifiers for chosen in selected_meshes(context)):
        return rpt_("The mesh has no faces")
    return ""


def selected_meshes(context: Context) -> list[Object]:
    """Return the selected mesh objects, sorted by name so that their order does not depend on the scene's."""
    return sorted((o for o in context.selected_objects if o.type == "MESH"), key=lambda o: o.name)


def summary(name: str, report: dict[str, Any]) -> str:
    """Return one line about a result."""
    error = report["surface_error"]
    return rpt_("'{}': {} patches, surface error rms {:.3g}, max {:.3g}, {:.1f} s").format(
        name, report["patches"], error["rms"], error["max"], report["seconds"]["total"]
    )


def _refusal(name: str, error: BaseException, count: int) -> str:
    text = str(error) or rpt_("There is not enough memory for this mesh.")
    return text if count == 1 else f"'{name}': {text}"


def _solve_here(source: Source, settings: Settings, context: Context, number: int, count: int) -> Result:
    from ..solver.job import approximate_arrays
    from ..solver.progress import run_to_end

    manager = context.window_manager
    manager.progress_begin(0.0, count)

    def show(step: Progress) -> None:
        manager.progress_update(number + step.fraction)

    try:
        return run_to_end(approximate_arrays(source.arrays, settings), show)
    finally:
        manager.progress_end()


def _make_result(context: Context, source: Source, result: Result) -> Object:
    from . import mesh_data

    settings = context.scene.sparse_surface
    made = mesh_data.create_result(
        context, source, result, colour_scale(context.scene, result.error), replace=settings.replace_result
    )
    original = mesh_data.find_object(source.session_uid)
    if settings.hide_original and original is not None:
        original.hide_set(True)
    return made


CLASSES = (SPARSE_SURFACE_OT_approximate,)

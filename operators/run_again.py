"""The operator that shows the settings of a result, lets them be changed, and solves its source again."""

from dataclasses import replace
from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Event, Object, Operator

from ..solver.errors import SettingsError
from ..solver.settings import Settings
from .data.objects import select_only
from .data.origins import source_of, was_made
from .data.result_keys import read_report
from .run.poll import made_object, needs, no_run, object_mode, packages, result

SHOWN = ("ring", "degree", "sparsity", "iterations", "sweeps", "domains")
"""What the dialog shows of every result."""

SHOWN_OF_CLOUDS = ("robust", "corrections")


class SPARSE_SURFACE_OT_run_again(Operator):
    bl_idname = "sparse_surface.run_again"
    bl_label = "Run Again"
    bl_description = (
        "Show the settings that made the active result, change them, and solve its source again. The new surface "
        "replaces the result"
    )

    poll = needs(packages, no_run, object_mode, result, made_object)

    _before: Settings | None = None

    def invoke(self, context: Context, event: Event) -> set[str]:
        """Put the result's settings into the scene, and show them."""
        own = context.scene.sparse_surface
        self._before = own.to_settings()
        try:
            own.take_settings(settings_of(context))
        except SettingsError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return set(
            context.window_manager.invoke_props_dialog(
                self, width=320, title=iface_("Run Again"), confirm_text=iface_("Run Again")
            )
        )

    def draw(self, context: Context) -> None:
        own, layout = context.scene.sparse_surface, self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        if _of_points(context):
            for name in SHOWN_OF_CLOUDS:
                layout.prop(own.reconstruction, name)
        for name in SHOWN:
            layout.prop(own, name)
        if _of_points(context):
            return
        row = layout.row(heading="Tolerance", align=True)
        row.prop(own, "use_tolerance", text="")
        row.prop(own, "tolerance_given", text="")
        layout.prop(own, "denoise")

    def cancel(self, context: Context) -> None:
        """Give the scene its settings back."""
        if self._before is not None:
            context.scene.sparse_surface.take_settings(self._before)

    def execute(self, context: Context) -> set[str]:
        own = context.scene.sparse_surface
        if self._before is None:  # called by a script: nothing was shown
            try:
                own.take_settings(settings_of(context))
            except SettingsError as error:
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
        solve = bpy.ops.sparse_surface.reconstruct if _of_points(context) else bpy.ops.sparse_surface.approximate
        chosen = [*_other_parts(context.active_object), context.active_object]
        select_only(context, chosen)
        hidden = sum(not each.select_get() for each in chosen)
        if hidden:
            text = rpt_("{} other parts of the surface are hidden; their borders with what is solved again come apart")
            self.report({"WARNING"}, text.format(hidden))
        if bpy.app.background or self._before is None:
            return set(solve("EXEC_DEFAULT", True))
        solve("INVOKE_DEFAULT")  # from now on it runs by itself, and makes an undo step of its own
        return {"FINISHED"}


def _other_parts(result: Object) -> list[Object]:
    """Return the results that are parts of one surface with this one, one of each source that still exists."""
    parts, sources = _parts(result), {source_of(result)}
    found: list[Object] = []
    for each in bpy.data.objects if parts else ():
        source = source_of(each) if was_made(each) and _parts(each) == parts else None
        if source is not None and source not in sources:
            sources.add(source)
            found.append(each)
    return found


def _parts(result: Object) -> Any:
    """Return the names of the objects that were solved together, if the report says so."""
    told = (read_report(result) or {}).get("input")
    return told.get("parts") if isinstance(told, dict) else None


def settings_of(context: Context) -> Settings:
    """Return the settings that made the active result, on as many workers as the scene says.

    Raises
    ------
    SettingsError
        When another version made it, whose settings this one does not have.
    """
    report: Any = read_report(context.active_object)
    now = context.scene.sparse_surface.to_settings()
    return replace(Settings.from_dict(report["settings"]), workers=now.workers, solver=now.solver)


def _of_points(context: Context) -> bool:
    report: Any = read_report(context.active_object)
    return report is not None and "points" in report["input"]

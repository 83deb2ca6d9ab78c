"""The operator behind the button: selected meshes in, sparse surfaces out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Object, Operator

from ..solver.errors import SparseSurfaceError
from .heat_map.scale import colour_scale
from .run import control as running
from .run.operator import Solved, Solving, Task, read_sources, scene_settings
from .run.requirements import missing_packages

if TYPE_CHECKING:
    from .data.meshes import Result, Source


class SPARSE_SURFACE_OT_approximate(Solving, Operator):
    """Approximate each selected mesh by smooth patches that keep its sharp features. The result is a new object"""

    bl_idname = "sparse_surface.approximate"
    bl_label = "Approximate"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: Context) -> bool:
        reason = reason_against(context)
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def tasks(self, context: Context) -> tuple[list[Task], list[str]]:
        """All selected meshes with the scene's settings."""
        sources, refusals = read_sources(context, selected_meshes(context) or list(context.selected_objects)[:1])
        settings = scene_settings(context)
        return [(source, settings) for source in sources], refusals

    def make_objects(self, context: Context, done: Sequence[Solved], refusals: list[str]) -> list[Object]:
        """A result object for each source."""
        made = []
        for source, result in done:
            try:
                made.append(_make_result(context, source, result))
            except SparseSurfaceError as error:
                refusals.append(str(error))
            else:
                self.say_result(source.name, result.report)
        return made


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
        active = context.view_layer.objects.active
        if active is not None and not active.visible_get():  # Blender deselects what it hides
            return rpt_("'{}' is hidden: show it first").format(active.name)
        return rpt_("Select a mesh")
    if not selected_meshes(context):
        return rpt_("The selected object is not a mesh; convert it first (Object > Convert > Mesh)")
    if not any(chosen.data.polygons or chosen.modifiers for chosen in selected_meshes(context)):
        return rpt_("The mesh has no faces")
    return ""


def selected_meshes(context: Context) -> list[Object]:
    """Return the selected mesh objects, sorted by name so that their order does not depend on the scene's."""
    return sorted((o for o in context.selected_objects if o.type == "MESH"), key=lambda o: o.name)


def _make_result(context: Context, source: Source, result: Result) -> Object:
    from .data import meshes as mesh_data

    settings = context.scene.sparse_surface
    made = mesh_data.create_result(
        context, source, result, colour_scale(context.scene, result.error), replace=settings.replace_result
    )
    original = mesh_data.find_object(source.session_uid)
    if settings.hide_original and original is not None:
        original.hide_set(True)
    return made


CLASSES = (SPARSE_SURFACE_OT_approximate,)

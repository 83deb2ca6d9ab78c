"""The operator that approximates the same mesh twice, to see the results side by side on one colour scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Object, Operator
from mathutils import Matrix, Vector

from ..solver.errors import SparseSurfaceError
from ..solver.settings import PRESETS, Settings
from .approximate import reason_against, selected_meshes
from .data.result_keys import cut_name
from .heat_map.scale import colour_scale
from .run.operator import Solved, Solving, Task, read_sources, scene_settings

if TYPE_CHECKING:
    from .data.colours import ColourScale
    from .data.meshes import Result

SPACE = 0.15
"""Room between the objects, in the source's width."""


class SPARSE_SURFACE_OT_compare_methods(Solving, Operator):
    """Approximate the active mesh with two settings. Two new objects show the errors on one colour scale"""

    bl_idname = "sparse_surface.compare_methods"
    bl_label = "Compare Methods"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: Context) -> bool:
        reason = reason_against(context)
        if not reason and len(selected_meshes(context)) != 1:
            reason = rpt_("Select one mesh")
        comparison = context.scene.sparse_surface.comparison
        if not reason and comparison.first == comparison.second:
            reason = rpt_("Choose two settings that differ")
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def tasks(self, context: Context) -> tuple[list[Task], list[str]]:
        """The mesh twice."""
        comparison = context.scene.sparse_surface.comparison
        sources, refusals = read_sources(context, selected_meshes(context))
        choices = comparison.first, comparison.second
        return [(source, chosen_settings(context, choice)) for source in sources for choice in choices], refusals

    def make_objects(self, context: Context, done: Sequence[Solved], refusals: list[str]) -> list[Object]:
        """Two results with one scale; with only one solved there is nothing to compare."""
        if len(done) < 2:
            if not refusals:
                refusals.append(rpt_("Only one of the two was solved, so there is nothing to compare."))
            return []
        try:
            made = _make_pair(context, done)
        except SparseSurfaceError as error:
            refusals.append(str(error))
            return []
        for (_, result), shown in zip(done, made, strict=True):
            self.say_result(shown.name, result.report)
        return made


def chosen_settings(context: Context, choice: str) -> Settings:
    """Return the settings that a choice of `SparseSurfaceComparison` stands for."""
    scene = scene_settings(context)
    if choice == "SCENE":
        return scene
    return Settings(**{**PRESETS[choice.removeprefix("PRESET_")], "workers": scene.workers})


def _make_pair(context: Context, done: Sequence[Solved]) -> list[Object]:
    import numpy as np

    comparison = context.scene.sparse_surface.comparison
    scale = colour_scale(context.scene, np.concatenate([result.error for _, result in done]))
    choices = (comparison.first, comparison.second)
    titles = [_title(choice, result) for choice, (_, result) in zip(choices, done, strict=True)]
    made = make_pair(context, done, titles, scale, beside=comparison.beside)
    _fix_range(context, scale.high)
    return made


def make_pair(
    context: Context, done: Sequence[Solved], titles: Sequence[str], scale: ColourScale, *, beside: bool
) -> list[Object]:
    """Make the result objects of one source, coloured with one scale and named after `titles`.

    With `beside` they stand at the source's right; otherwise where the source stands.

    Raises
    ------
    SparseSurfaceError
        When the source was removed or edited since it was read.
    """
    from .data import meshes as mesh_data

    made = []
    for place, ((source, result), title) in enumerate(zip(done, titles, strict=True)):
        shown = mesh_data.create_result(context, source, result, scale)
        shown.name = cut_name(shown.name, f" {place + 1} {title}")
        shown.data.name = shown.name
        if beside:
            width = _width(context, shown)
            shift = Vector(((place + 1) * (1.0 + SPACE) * width, 0.0, 0.0))
            shown.matrix_world = Matrix.Translation(shift) @ shown.matrix_world
        made.append(shown)
    return made


def _width(context: Context, shown: Object) -> float:
    context.view_layer.update()
    along = [(shown.matrix_world @ Vector(corner)).x for corner in shown.bound_box]
    return max(along) - min(along)


def _title(choice: str, result: Result) -> str:
    method: str = result.report["settings"]["method"]
    return (method if choice == "SCENE" else choice.removeprefix("PRESET_")).title()


def _fix_range(context: Context, high: float) -> None:
    """Keep the common scale also when colours are made anew: the range becomes a fixed one."""
    display = context.scene.sparse_surface.display
    if not display.inside_outside and high > 0.0:
        display.range_maximum = high
        display.range_mode = "FIXED"


CLASSES = (SPARSE_SURFACE_OT_compare_methods,)

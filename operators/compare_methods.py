"""The operator that approximates one mesh twice and shows the results beside each other on one colour scale."""

from __future__ import annotations

from collections.abc import Sequence

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Object, Operator

from ..solver.errors import SparseSurfaceError
from ..solver.settings import Settings
from .data.objects import find_object, selected_meshes
from .data.presets import preset_values
from .data.visibility import hide
from .run.operator import Solved, SolverOperator, Task, read_sources, scene_settings
from .run.poll import MESHES_TO_SOLVE, needs, one_mesh


def two_settings(context: Context) -> str:
    """The two chosen settings differ."""
    comparison = context.scene.sparse_surface.comparison
    return rpt_("Choose two different settings") if comparison.first == comparison.second else ""


class SPARSE_SURFACE_OT_compare_methods(SolverOperator, Operator):
    """Approximate the active mesh with two settings. Two new objects show the errors on one colour scale"""

    bl_idname = "sparse_surface.compare_methods"
    bl_label = "Compare Methods"
    bl_options = {"UNDO"}

    poll = needs(*MESHES_TO_SOLVE, one_mesh, two_settings)

    def tasks(self, context: Context) -> tuple[list[Task], list[str]]:
        """The mesh twice."""
        comparison = context.scene.sparse_surface.comparison
        sources, refusals = read_sources(context, selected_meshes(context))
        choices = comparison.first, comparison.second
        return [(source, chosen_settings(context, choice)) for source in sources for choice in choices], refusals

    def make_objects(self, context: Context, done: Sequence[Solved], refusals: list[str]) -> list[Object]:
        """Two results with one scale; a single one has nothing to be compared with."""
        from .heat_map.pairs import compare_pair, show_pair  # NumPy-heavy: enabling the add-on loads this module

        if len(done) < 2:
            if not refusals:
                refusals.append(rpt_("Only one of the two was solved, so there is nothing to compare."))
            return []
        comparison = context.scene.sparse_surface.comparison
        try:
            made = compare_pair(context, done, comparison.first, comparison.second, beside=comparison.beside)
        except SparseSurfaceError as error:
            refusals.append(str(error))
            return []
        source = find_object(done[0][0].session_uid)
        if source is not None and context.scene.sparse_surface.source_shown == "HIDDEN":
            hide(source, context)
        for (_, result), shown in zip(done, made, strict=True):
            self.say_result(shown.name, result.report)
        show_pair(made, context)
        return made


def chosen_settings(context: Context, choice: str) -> Settings:
    """Return the settings that a choice of `SparseSurfaceComparison` stands for."""
    scene = scene_settings(context)
    if choice == "SCENE":
        return scene
    return Settings.from_dict({**preset_values(choice.removeprefix("PRESET_")), "workers": scene.workers})

"""The operator behind the button: selected meshes in, sparse surfaces out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from bpy.props import BoolProperty
from bpy.types import Context, Object, Operator

from .data.objects import chosen_objects, selected_meshes
from .run.operator import Solved, SolverOperator, Task, read_sources, scene_settings
from .run.poll import MESHES_TO_SOLVE, needs

if TYPE_CHECKING:
    from ..solver.approximation.result import Approximation
    from .data.meshes import Source
    from .data.parts import Parts


class SPARSE_SURFACE_OT_approximate(SolverOperator, Operator):
    """Approximate each selected mesh by smooth patches that keep its sharp features. The result is a new object"""

    bl_idname = "sparse_surface.approximate"
    bl_label = "Approximate"
    bl_options = {"UNDO"}

    only_denoise: BoolProperty(
        name="Only Denoise",
        description="Remove noise and make no patches, whatever the settings of the scene say of noise",
        default=False,
        options={"SKIP_SAVE"},
    )

    poll = needs(*MESHES_TO_SOLVE)

    def tasks(self, context: Context) -> tuple[list[Task], list[str]]:
        """All selected meshes with the scene's settings; those that share a border are one surface."""
        settings = scene_settings(context)
        if self.only_denoise:
            settings = replace(settings, denoise="only")
        chosen = selected_meshes(context) or chosen_objects(context)[:1]
        sources, refusals = read_sources(context, chosen, together=settings)
        return [(source, settings) for source in sources], refusals

    def make_objects(self, context: Context, done: Sequence[Solved], refusals: list[str]) -> list[Object]:
        """A result object for each mesh."""
        from .heat_map.scale import create_coloured  # NumPy-heavy: enabling the add-on loads this module

        replacing = context.scene.sparse_surface.replace_result

        def make(source: Source | Parts, result: Approximation) -> list[Object]:
            return create_coloured(context, source, result, refusals, replace=replacing)

        return self.make_each(make, context, done, refusals)

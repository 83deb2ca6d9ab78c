"""The operator that makes a surface of a point cloud, over a base that is chosen or made."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Object, Operator

from ..solver.errors import SparseSurfaceError
from .data.objects import selected_points
from .run.operator import Solved, SolverOperator, Task, refusal, scene_settings
from .run.poll import needs, no_run, object_mode, packages, points

# NumPy-heavy modules are imported inside functions: enabling the add-on loads this module.
if TYPE_CHECKING:
    from ..solver.interchange import CloudOutcome
    from .data.points import CloudSource


class SPARSE_SURFACE_OT_reconstruct(SolverOperator, Operator):
    """Make a surface of the active object's points: a mesh's vertices or a point cloud. The result is a new object"""

    bl_idname = "sparse_surface.reconstruct"
    bl_label = "Reconstruct"
    bl_options = {"UNDO"}
    has_preview = False

    poll = needs(packages, no_run, object_mode, points)

    def tasks(self, context: Context) -> tuple[list[Task], list[str]]:
        """The active points with the scene's settings."""
        from .data.points import read_cloud

        chosen = selected_points(context)
        if chosen is None:
            return [], [rpt_("Select a mesh or a point cloud")]
        wanted = context.scene.sparse_surface.reconstruction
        try:
            source = read_cloud(
                context, chosen, wanted.base, wanted.base_vertices, wanted.to_cloud_settings(), wanted.splits
            )
        except (SparseSurfaceError, MemoryError) as error:
            return [], [refusal(chosen.name, error, 1)]
        return [(source, scene_settings(context))], []

    def make_objects(self, context: Context, done: Sequence[Solved], refusals: list[str]) -> list[Object]:
        """The surface, the points with their errors, and the base if it is kept."""
        from .data.results import create_base, create_point_errors, create_surface
        from .heat_map.scale import colour_scale

        wanted = context.scene.sparse_surface.reconstruction
        replace = context.scene.sparse_surface.replace_result

        def make(source: CloudSource, result: CloudOutcome) -> list[Object]:
            scale = colour_scale(context.scene, result.point_error)
            surface = create_surface(context, source, result, scale, replace=replace)
            if wanted.point_errors:
                create_point_errors(context, source, result, scale, replace=replace)
            if wanted.keep_base and result.made_base is not None:
                create_base(context, source, *result.made_base, replace=replace)
            return [surface]

        return self.make_each(make, context, done, refusals, [wanted.base] if wanted.base is not None else [])

"""The operator that evaluates a result's surface on a finer mesh."""

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.props import IntProperty
from bpy.types import Context, Object, Operator

from ..solver.errors import SparseSurfaceError
from ..solver.settings import MOST_SPLITS
from .data.objects import last_source, select_only
from .data.result_keys import has_representation
from .data.visibility import settle
from .run.poll import needs, no_run, object_mode, without_functions


def surface(context: Context) -> str:
    """The active object holds a representation, or was made from one that does."""
    return "" if _holder(context) is not None else without_functions(context.active_object)


def _holder(context: Context) -> Object | None:
    active = context.active_object
    return active if active is None or has_representation(active) else last_source(active, has_representation)


class SPARSE_SURFACE_OT_resample(Operator):
    """Show a finer mesh instead of the active result: every edge is split, quads stay quads, layers are kept"""

    bl_idname = "sparse_surface.resample"
    bl_label = "Resample"
    bl_options = {"REGISTER", "UNDO"}

    splits: IntProperty(
        name="Splits",
        description="Number of parts of every edge. The number of faces grows with its square",
        default=2,
        min=1,
        max=MOST_SPLITS,
        soft_max=8,
    )

    poll = needs(no_run, object_mode, surface)

    def execute(self, context: Context) -> set[str]:
        from .representation.resampled import resample_object  # loads SciPy; enabling the add-on must not

        try:
            made = resample_object(
                context, _holder(context), self.splits, replace=context.scene.sparse_surface.replace_result
            )
        except (SparseSurfaceError, MemoryError) as error:
            self.report({"ERROR"}, str(error) or rpt_("There is not enough memory for this number of faces."))
            return {"CANCELLED"}
        settle([made], context)
        select_only(context, [made])
        mesh = made.data
        text = rpt_("'{}': {} vertices, {} faces")
        self.report({"INFO"}, text.format(made.name, len(mesh.vertices), len(mesh.polygons)))
        return {"FINISHED"}

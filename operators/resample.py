"""The operator that evaluates a result's surface on a finer mesh."""

from __future__ import annotations

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.props import IntProperty
from bpy.types import Context, Operator

from ..solver.errors import SparseSurfaceError
from ..solver.settings import MOST_SPLITS
from .data.objects import select_only
from .run.poll import SURFACE, needs


class SPARSE_SURFACE_OT_resample(Operator):
    """Make a finer mesh of the active result's surface: every edge is split, quads stay quads, layers are kept"""

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

    poll = needs(*SURFACE)

    def execute(self, context: Context) -> set[str]:
        from .representation.resampled import resample_object  # loads SciPy; enabling the add-on must not

        try:
            made = resample_object(context, context.active_object, self.splits)
        except (SparseSurfaceError, MemoryError) as error:
            self.report({"ERROR"}, str(error) or rpt_("There is not enough memory for this number of faces."))
            return {"CANCELLED"}
        select_only(context, [made])
        mesh = made.data
        text = rpt_("'{}': {} vertices, {} faces")
        self.report({"INFO"}, text.format(made.name, len(mesh.vertices), len(mesh.polygons)))
        return {"FINISHED"}

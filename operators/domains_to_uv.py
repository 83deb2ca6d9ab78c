"""The operator that writes the patches' domains as UV maps."""

from __future__ import annotations

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Operator

from ..solver.errors import SparseSurfaceError
from .run.poll import SURFACE, editable, needs


class SPARSE_SURFACE_OT_domains_to_uv(Operator):
    """Write the initial and the optimised domains as UV maps, each face in the chart of the patch that counts most"""

    bl_idname = "sparse_surface.domains_to_uv"
    bl_label = "Domains as UV Maps"
    bl_options = {"REGISTER", "UNDO"}

    poll = needs(*SURFACE, editable)

    def execute(self, context: Context) -> set[str]:
        from .representation.domain_maps import write_domain_maps  # loads SciPy; enabling the add-on must not

        try:
            names = write_domain_maps(context.active_object)
        except SparseSurfaceError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, rpt_("UV maps: {}").format(", ".join(names)))
        return {"FINISHED"}

"""The operator that makes an object of each of a result's patches, not blended with the others."""

from __future__ import annotations

from functools import partial

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Operator

from ..solver.errors import SparseSurfaceError
from .data.lengths import length_text
from .data.visibility import settle
from .run.poll import SURFACE, needs


class SPARSE_SURFACE_OT_separate_patches(Operator):
    """Make an object of each patch of the active result as it is before blending, and measure the gaps between them"""

    bl_idname = "sparse_surface.separate_patches"
    bl_label = "Separate Patches"
    bl_options = {"REGISTER", "UNDO"}

    poll = needs(*SURFACE)

    def execute(self, context: Context) -> set[str]:
        from .representation.separated import separate_patches  # loads SciPy; enabling the add-on must not

        try:
            patches, gaps = separate_patches(context, context.active_object)
            settle(patches.objects[:], context)
        except SparseSurfaceError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        text = rpt_("{} patches; gaps where they overlap: rms {}, max {}")
        length = partial(length_text, context.scene, digits=3)
        self.report({"INFO"}, text.format(len(patches.objects), length(gaps["rms"]), length(gaps["max"])))
        return {"FINISHED"}

"""The operator that ends the running approximation early with the best result so far."""

from __future__ import annotations

from bpy.types import Context, Operator

from .run import control as running


class SPARSE_SURFACE_OT_finish(Operator):
    """Stop refining and keep the best result so far; objects that were not begun are left out"""

    bl_idname = "sparse_surface.finish"
    bl_label = "Finish Now"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: Context) -> bool:
        return running.current is not None and not running.current.finishing

    def execute(self, context: Context) -> set[str]:
        run = running.current
        if run is None:
            return {"CANCELLED"}
        run.finish()
        return {"FINISHED"}


CLASSES = (SPARSE_SURFACE_OT_finish,)

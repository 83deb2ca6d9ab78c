"""The operator that ends the running approximation early with the best result so far."""

from __future__ import annotations

from bpy.types import Context, Operator

from .run.session import session


class SPARSE_SURFACE_OT_finish(Operator):
    """Stop refining and keep the best result so far; objects whose turn has not come are left out"""

    bl_idname = "sparse_surface.finish"
    bl_label = "Finish Now"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: Context) -> bool:
        return session.current is not None and not session.current.finishing

    def execute(self, context: Context) -> set[str]:
        if session.current is None:
            return {"CANCELLED"}
        session.current.finish()
        return {"FINISHED"}

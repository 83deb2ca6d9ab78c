"""The operator that ends the running approximation and leaves nothing behind."""

from __future__ import annotations

from bpy.types import Context, Operator

from .run.session import session


class SPARSE_SURFACE_OT_cancel(Operator):
    """End the running approximation and discard its work so far"""

    bl_idname = "sparse_surface.cancel"
    bl_label = "Cancel"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: Context) -> bool:
        return session.current is not None

    def execute(self, context: Context) -> set[str]:
        session.stop()  # the modal operator sees it at its next tick and removes what it shows
        return {"FINISHED"}

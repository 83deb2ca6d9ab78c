"""The operator that ends the running approximation and leaves nothing behind."""

from __future__ import annotations

from bpy.types import Context, Operator

from .run import control as running


class SPARSE_SURFACE_OT_cancel(Operator):
    """End the running approximation and drop what it has done so far"""

    bl_idname = "sparse_surface.cancel"
    bl_label = "Cancel"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: Context) -> bool:
        return running.current is not None

    def execute(self, context: Context) -> set[str]:
        running.stop()  # the modal operator sees it at its next tick and takes back what it shows
        return {"FINISHED"}


CLASSES = (SPARSE_SURFACE_OT_cancel,)

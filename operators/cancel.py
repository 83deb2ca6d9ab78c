"""The operator that ends the running approximation and leaves nothing behind."""

from __future__ import annotations

from bpy.app.translations import pgettext_iface as iface_
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Event, Operator

from .run.session import session


class SPARSE_SURFACE_OT_cancel(Operator):
    """End the running approximation and discard its work so far"""

    bl_idname = "sparse_surface.cancel"
    bl_label = "Cancel"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: Context) -> bool:
        return session.current is not None

    def invoke(self, context: Context, event: Event) -> set[str]:
        """Ask before a finished surface is thrown away."""
        if session.current is None or not session.current.waiting:
            return self.execute(context)
        question = rpt_("The surface is ready and waits for Object Mode. Discard it?")
        return set(
            context.window_manager.invoke_confirm(
                self, event, title=iface_("Discard the Surface"), message=question, confirm_text=iface_("Discard")
            )
        )

    def execute(self, context: Context) -> set[str]:
        session.stop()  # the modal operator sees it at its next tick and removes what it shows
        return {"FINISHED"}

"""The operator that ends the running approximation early with the best result so far."""

from __future__ import annotations

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Operator

from .run.session import session


class SPARSE_SURFACE_OT_finish(Operator):
    """Stop refining and keep the best result so far; objects whose turn has not come are left out"""

    bl_idname = "sparse_surface.finish"
    bl_label = "Finish Now"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: Context) -> bool:
        if session.current is not None and not (session.current.finishing or session.current.can_finish):
            cls.poll_message_set(rpt_("There is no surface yet that could be kept"))
        return session.current is not None and session.current.can_finish

    def execute(self, context: Context) -> set[str]:
        if session.current is None:
            return {"CANCELLED"}
        session.current.finish()
        return {"FINISHED"}

"""The operator that gives the surface of a result to its source, which keeps everything else."""

from __future__ import annotations

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Operator

from ..solver.errors import InputError
from .data.lengths import length_text
from .data.objects import chosen_results, select_only
from .data.viewports import join_local_views
from .data.visibility import hide, show, stand_in_place
from .run.poll import made_object, needs, no_run, object_mode


class SPARSE_SURFACE_OT_apply_to_source(Operator):
    bl_idname = "sparse_surface.apply_to_source"
    bl_label = "Apply to Source"
    bl_description = (
        "Move the vertices of the source to where the result has them. The source keeps its modifiers, rig, shape keys "
        "and all else; the result is hidden"
    )
    bl_options = {"REGISTER", "UNDO"}

    poll = needs(object_mode, no_run, made_object)

    def execute(self, context: Context) -> set[str]:
        from .data.applied import apply_to_source, sharing  # NumPy-heavy: enabling the add-on loads this module

        changed, refusals = [], []
        for made, source in list(chosen_results(context)):
            try:
                left = apply_to_source(made, context)
            except InputError as error:
                refusals.append(str(error))
                continue
            stand_in_place(made, context)
            show(source, context)
            join_local_views(source, made, context)
            hide(made, context)
            changed.append(source)
            text = rpt_("'{}' has the surface of its result").format(source.name)
            if left > 1e-5 * max(source.dimensions):
                left_text = length_text(context.scene, left, digits=3)
                text = rpt_("'{}' follows its result to {}: its modifiers allow no more").format(source.name, left_text)
            self.report({"INFO"}, text)
            if others := sharing(source):
                text = rpt_("These have the same mesh and change, too: {}")
                self.report({"WARNING"}, text.format(", ".join(others)))
        for sentence in refusals:
            self.report({"WARNING"} if changed else {"ERROR"}, sentence)
        if not changed:
            return {"CANCELLED"}
        select_only(context, changed)
        return {"FINISHED"}

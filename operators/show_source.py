"""The operator that shows the sources of results again, or hides them."""

from bpy.props import BoolProperty
from bpy.types import Context, Operator

from .data.objects import chosen_results, select_only
from .data.visibility import hide, show, stand_beside, stand_in_place
from .run.poll import made_object, needs, object_mode


class SPARSE_SURFACE_OT_show_source(Operator):
    """Show what the selected results were made from, in the viewport and in renders. Press again to hide it"""

    bl_idname = "sparse_surface.show_source"
    bl_label = "Show Source"
    bl_options = {"REGISTER", "UNDO"}

    beside: BoolProperty(
        name="Side by Side",
        description="Put the result at the right of its source while both are shown; otherwise they lie in one place",
        default=False,
    )

    poll = needs(object_mode, made_object)

    def execute(self, context: Context) -> set[str]:
        pairs = list(chosen_results(context))
        showing = not all(source.visible_get() for _, source in pairs)
        for made, source in pairs:
            if showing:
                show(source, context)
                if self.beside:
                    stand_beside([made], context)
            else:
                stand_in_place(made, context)
                hide(source, context)
        select_only(context, [made for made, _ in pairs])
        return {"FINISHED"}

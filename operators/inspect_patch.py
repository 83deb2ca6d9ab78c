"""The operator that lays one patch of a result out, and steps from patch to patch."""

from bpy.props import EnumProperty
from bpy.types import Context, Operator

from ..solver.errors import SparseSurfaceError
from .data.viewports import frame
from .run.poll import SURFACE, needs


class SPARSE_SURFACE_OT_inspect_patch(Operator):
    """Lay the patch's initial and optimised domains flat beside the result, with its functions over the domain"""

    bl_idname = "sparse_surface.inspect_patch"
    bl_label = "Inspect Patch"
    bl_options = {"REGISTER", "UNDO"}

    which: EnumProperty(
        name="Patch",
        items=[
            ("CHOSEN", "Chosen", "The patch whose number the panel shows"),
            ("NEXT", "Next", "The patch after it"),
            ("PREVIOUS", "Previous", "The patch before it"),
            ("SELECTED", "Selected", "The patch that counts most at the vertices selected in Edit Mode"),
        ],
        default="CHOSEN",
        options={"SKIP_SAVE"},
    )

    poll = needs(*SURFACE)

    def execute(self, context: Context) -> set[str]:
        # These load SciPy; enabling the add-on must not.
        from .representation.patch_sheets import choose_patch, inspect_patch

        holder = context.active_object
        first = context.scene.sparse_surface.inspection.holder != holder.name
        try:
            patch = choose_patch(context, holder, self.which)
            shown = inspect_patch(context, holder, patch)
        except SparseSurfaceError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        context.scene.sparse_surface.inspection.patch = patch
        if first:  # later steps leave the view where the user has moved it
            frame([holder, *shown], context)
        return {"FINISHED"}

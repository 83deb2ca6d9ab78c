"""The operator that shows the cover: every vertex in the colour of the patch that counts most there."""

from __future__ import annotations

from bpy.types import Context, Operator

from .run.poll import editable, needs, object_mode, patches


class SPARSE_SURFACE_OT_show_patches(Operator):
    """Colour each vertex by the patch that counts most there; press again to return to the errors"""

    bl_idname = "sparse_surface.show_patches"
    bl_label = "Show Patches"
    bl_options = {"REGISTER", "UNDO"}

    poll = needs(object_mode, patches, editable)

    def execute(self, context: Context) -> set[str]:
        from .heat_map.patch_colours import toggle_patch_colours  # NumPy-heavy: enabling the add-on loads this module

        toggle_patch_colours(context.active_object)
        return {"FINISHED"}

"""The operator that shows the cover: every vertex in the colour of the patch that counts most there."""

from __future__ import annotations

from bpy.types import Context, Operator, SpaceView3D

from .data.result_keys import shows_patches
from .heat_map.shown import restore, show, shows_colours, shows_for_patches
from .run.poll import editable, needs, object_mode, patches


class SPARSE_SURFACE_OT_show_patches(Operator):
    """Colour each vertex by the patch that counts most there, in any shading; press again to return"""

    bl_idname = "sparse_surface.show_patches"
    bl_label = "Show Patches"
    bl_options = {"REGISTER", "UNDO"}

    poll = needs(object_mode, patches, editable)

    def execute(self, context: Context) -> set[str]:
        from .heat_map.patch_colours import toggle_patch_colours  # NumPy-heavy: enabling the add-on loads this module

        toggle_patch_colours(context.active_object)
        space = context.space_data
        if isinstance(space, SpaceView3D):  # the colours are to be seen, whatever the shading
            if shows_patches(context.active_object):
                if not shows_colours(space):
                    show(space, context, for_patches=True)
            elif shows_for_patches(space):
                restore(space)
        return {"FINISHED"}

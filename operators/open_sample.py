"""The operator that opens a scene to try everything on."""

from __future__ import annotations

from bpy.types import Context, Operator

from .data.viewports import frame
from .run.poll import needs, no_run, object_mode


class SPARSE_SURFACE_OT_open_sample(Operator):
    """Add and show a scene with a sharp-edged part, a noisy scan and points. Your own scene stays as it is"""

    bl_idname = "sparse_surface.open_sample"
    bl_label = "Open Sample Scene"
    bl_options = {"REGISTER", "UNDO"}

    poll = needs(object_mode, no_run)

    def execute(self, context: Context) -> set[str]:
        from .data.sample import sample_scene  # NumPy-heavy: enabling the add-on loads this module

        scene = sample_scene()
        if context.window is not None:
            context.window.scene = scene
        frame(scene.collection.objects[:], context)
        return {"FINISHED"}

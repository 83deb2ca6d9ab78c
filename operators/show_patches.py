"""The operator that shows the cover: every vertex in the colour of the patch that counts most there."""

from __future__ import annotations

import colorsys
from typing import TYPE_CHECKING

from bpy.types import Context, Object, Operator

from .data.result_keys import ERROR_COLOUR, PATCH, PATCH_COLOUR

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

GOLDEN_RATIO = 0.6180339887
PASSED_THROUGH = (0.5, 0.5, 0.5)


class SPARSE_SURFACE_OT_show_patches(Operator):
    """Colour each vertex by the patch that counts most there; press again to return to the errors"""

    bl_idname = "sparse_surface.show_patches"
    bl_label = "Show Patches"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Context) -> bool:
        active = context.active_object
        if context.mode != "OBJECT":
            cls.poll_message_set("Switch to Object Mode first")
        elif not has_patches(active):
            cls.poll_message_set("Select a result: an object that Approximate has made")
        elif not active.data.is_editable:
            cls.poll_message_set("The active mesh is linked from another file and cannot be coloured")
        else:
            return True
        return False

    def execute(self, context: Context) -> set[str]:
        active = context.active_object
        if shows_patches(active):
            _choose(active, ERROR_COLOUR)
        else:
            colour_patches(active)
        return {"FINISHED"}


def has_patches(candidate: Object | None) -> bool:
    """Whether an object's mesh says which patch counts most at each vertex."""
    layer = candidate.data.attributes.get(PATCH) if candidate is not None and candidate.type == "MESH" else None
    return layer is not None and (layer.data_type, layer.domain) == ("INT", "POINT")


def shows_patches(shown: Object) -> bool:
    """Whether the patches' colours are the active ones."""
    active = shown.data.color_attributes.active_color
    return active is not None and active.name == PATCH_COLOUR


def colour_patches(shown: Object) -> None:
    """Write the colour of each vertex's patch and make these colours active."""
    import numpy as np

    mesh = shown.data
    patch = np.empty(len(mesh.vertices), dtype=np.int32)
    mesh.attributes[PATCH].data.foreach_get("value", patch)
    if mesh.attributes.get(PATCH_COLOUR) is None:
        mesh.attributes.new(PATCH_COLOUR, "FLOAT_COLOR", "POINT")
    colours = palette(int(patch.max(initial=-1)) + 1)[patch]  # -1 takes the last one
    mesh.attributes[PATCH_COLOUR].data.foreach_set("color", np.ascontiguousarray(colours).ravel())
    _choose(shown, PATCH_COLOUR)


def palette(count: int) -> NDArray[np.float32]:
    """Return linear RGBA for `count` patches and, last, for what no patch holds, (count + 1, 4).

    Numbers that follow each other get hues far apart; three levels of lightness tell like hues apart.
    """
    import numpy as np

    from .data.colours import srgb_to_linear

    levels = ((0.55, 0.95), (0.75, 0.75), (0.35, 0.85))
    colours = [colorsys.hsv_to_rgb(k * GOLDEN_RATIO % 1.0, *levels[k % 3]) for k in range(count)]
    rgba = np.ones((count + 1, 4), dtype=np.float32)
    rgba[:, :3] = srgb_to_linear(np.array([*colours, PASSED_THROUGH]))
    return rgba


def _choose(shown: Object, name: str) -> None:
    colours = shown.data.color_attributes
    index = colours.find(name)
    if index >= 0:
        colours.active_color_index = colours.render_color_index = index
        shown.data.update()


CLASSES = (SPARSE_SURFACE_OT_show_patches,)

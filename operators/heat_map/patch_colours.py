"""The colours of the patches on a result."""

from __future__ import annotations

import colorsys

import numpy as np
from bpy.types import Object
from numpy.typing import NDArray

from ..data import attributes
from ..data.colours import srgb_to_linear
from ..data.result_keys import ERROR_COLOUR, PATCH, PATCH_COLOUR, shows_patches

GOLDEN_RATIO = 0.6180339887
PASSED_THROUGH = (0.5, 0.5, 0.5)


def toggle_patch_colours(shown: Object) -> None:
    """Colour each vertex by the patch that counts most there, or return to the colours of the errors."""
    if shows_patches(shown):
        attributes.show_colours(shown.data, ERROR_COLOUR)
        return
    patch = attributes.read(shown.data, PATCH)
    colours = palette(int(patch.max(initial=-1)) + 1)[patch]  # -1 takes the last one
    attributes.write(shown.data, {PATCH_COLOUR: colours})
    attributes.show_colours(shown.data, PATCH_COLOUR)


def palette(count: int) -> NDArray[np.float32]:
    """Return linear RGBA for `count` patches and, last, for vertices without a patch, (count + 1, 4).

    Hues of consecutive numbers lie far apart; three levels of lightness separate similar hues.
    """
    levels = ((0.55, 0.95), (0.75, 0.75), (0.35, 0.85))
    colours = [colorsys.hsv_to_rgb(k * GOLDEN_RATIO % 1.0, *levels[k % 3]) for k in range(count)]
    rgba = np.ones((count + 1, 4), dtype=np.float32)
    rgba[:, :3] = srgb_to_linear(np.array([*colours, PASSED_THROUGH]))
    return rgba

"""Captions and the legend of a picture: whatever stands flat before the objects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from bpy.types import Object, Scene
from numpy.typing import NDArray

from ..data.attributes import put
from ..data.colours import ColourScale, ramp, srgb_to_linear
from .scene import View, add_object, dull_material

LEGEND_LENGTH, LEGEND_THICKNESS, LEGEND_Y = 6.4, 0.2, -3.75
"""In the units of the picture."""

LETTERING_DISTANCE = 30.0
"""Distance of captions and legend before the objects: nearer than any ground, so that nothing hides them."""

INK = (0.02, 0.02, 0.02)


@dataclass(frozen=True)
class Lettering:
    """Writes into a scene, in the units of the picture."""

    scene: Scene
    view: View

    def write(self, text: str, x: float, y: float, size: float, align: str = "CENTER") -> None:
        """Write a line of text at (x, y)."""
        curve = bpy.data.curves.new("Text", "FONT")
        curve.body, curve.size, curve.align_x = text, size, align
        curve.materials.append(dull_material("Ink", INK, shine=1.0))
        self._hide_from_light(add_object(self.scene, "Text", curve, self.view.matrix(x, y, LETTERING_DISTANCE)))

    def strip(self, colours: NDArray[np.floating[Any]], length: float, thickness: float, y: float) -> None:
        """Lay equal fields of the linear colours (n, 3) side by side."""
        count = len(colours)
        x = np.linspace(-length / 2, length / 2, count + 1)
        corners = [(at, side, 0.0) for at in x for side in (-thickness / 2, thickness / 2)]
        mesh = bpy.data.meshes.new("Scale")
        mesh.from_pydata(corners, [], [(2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1) for k in range(count)])
        rgba = np.ones((count, 4, 4), dtype=np.float32)
        rgba[..., :3] = np.asarray(colours)[:, None, :]
        put(mesh.color_attributes.new("colour", "FLOAT_COLOR", "CORNER").data, "color", rgba)
        mesh.materials.append(dull_material("Scale", INK, attribute="colour", shine=1.0))
        self._hide_from_light(add_object(self.scene, "Scale", mesh, self.view.matrix(0.0, y, LETTERING_DISTANCE)))

    @staticmethod
    def _hide_from_light(made: Object) -> None:
        made.visible_shadow = made.visible_diffuse = made.visible_glossy = False


def add_legend(letter: Lettering, scale: ColourScale) -> None:
    """Draw the colour scale with its values in scene units."""
    below = LEGEND_Y - LEGEND_THICKNESS / 2 - 0.3
    if scale.tolerance > 0.0:
        letter.strip(srgb_to_linear(np.array(scale.bands)), LEGEND_LENGTH, LEGEND_THICKNESS, LEGEND_Y)
        within = f"within {scale.tolerance:.3g}"
        ticks = (
            [(-1 / 3, "below"), (0.0, within), (1 / 3, "above")] if scale.signed else [(-0.25, within), (0.25, "above")]
        )
    else:
        letter.strip(ramp(scale.signed), LEGEND_LENGTH, LEGEND_THICKNESS, LEGEND_Y)
        values = np.linspace(scale.low, scale.high, 3)
        ticks = [(share, f"{value:.3g}") for share, value in zip((-0.5, 0.0, 0.5), values, strict=True)]
    for share, text in ticks:
        letter.write(text, share * LEGEND_LENGTH, below, 0.24)
    what = "distance" if scale.signed else "error"
    letter.write(f"{what} at the vertices, in scene units", 0.0, LEGEND_Y + 0.2, 0.24)

"""Captions and the legend of a picture: whatever stands flat before the objects, drawn after them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np
from bpy.types import Mesh
from numpy.typing import NDArray

from ..data.colours import ColourScale, linear_to_srgb, ramp, srgb_to_linear
from ..data.meshes import read_positions
from .raster import Shape

LEGEND_LENGTH, LEGEND_THICKNESS, LEGEND_Y = 6.4, 0.2, -3.75
"""In the units of the picture."""

FIELD_REACH = 0.1
"""How far a field of the legend reaches under the next ones: several pixels, so that none shows the ground."""

CURVE_STEPS = 4
"""Segments of each curve of a letter: at the sizes of a picture no more are seen, and each is a triangle to draw."""

INK = (0.02, 0.02, 0.02)


@dataclass(frozen=True)
class Lettering:
    """Collects shapes, in the units of the picture."""

    shapes: list[Shape] = field(default_factory=list)

    def write(self, text: str, x: float, y: float, size: float, align: str = "CENTER") -> None:
        """Write a line of text at (x, y)."""
        fonts = set(bpy.data.fonts)
        curve = bpy.data.curves.new("Text", "FONT")
        curve.body, curve.size, curve.align_x = text, size, align
        curve.resolution_u = CURVE_STEPS
        made = bpy.data.objects.new("Text", curve)
        mesh = bpy.data.meshes.new_from_object(made)
        self._add(_flat_triangles(mesh) + np.array([x, y]), INK)
        bpy.data.objects.remove(made)
        bpy.data.meshes.remove(mesh)
        bpy.data.curves.remove(curve)
        for font in set(bpy.data.fonts) - fonts:  # Blender's own, loaded with the first text
            bpy.data.fonts.remove(font)

    def strip(self, colours: NDArray[np.floating[Any]], length: float, thickness: float, y: float) -> None:
        """Lay equal fields of the linear colours (n, 3) side by side."""
        ends = np.linspace(-length / 2, length / 2, len(colours) + 1)
        low, high = y - thickness / 2, y + thickness / 2
        under = np.minimum(ends[:-1] + max(2 * length / len(colours), FIELD_REACH), length / 2)
        for colour, left, right in zip(colours, ends[:-1], under, strict=True):  # each over the ones before: no gaps
            self.field(colour, left, right, low, high)

    def field(self, colour: Sequence[float] | NDArray[Any], left: float, right: float, low: float, high: float) -> None:
        """Fill an upright rectangle with a linear colour."""
        corners = np.array([(left, low), (right, low), (right, high), (left, high)])
        self._add(corners[[[0, 1, 2], [0, 2, 3]]], colour)

    def _add(self, triangles: NDArray[Any], colour: Sequence[float] | NDArray[Any]) -> None:
        self.shapes.append(Shape(triangles, linear_to_srgb(np.asarray(colour, dtype=np.float64)[:3])))


def _flat_triangles(mesh: Mesh) -> NDArray[np.float64]:
    """Triangles of a flat mesh, (n, 3, 2)."""
    mesh.calc_loop_triangles()
    corners = np.array([triangle.vertices for triangle in mesh.loop_triangles], dtype=np.int64).reshape(-1, 3)
    return read_positions(mesh).astype(np.float64)[:, :2][corners]


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

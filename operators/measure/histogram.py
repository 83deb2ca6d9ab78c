"""A picture of the histogram of distances: bars in the colours of the heat map."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...solver.distance.distance import Distances
from ..data.attributes import put
from ..data.colours import ColourScale
from ..heat_map.lettering import INK, Lettering
from ..heat_map.png import render_png
from ..heat_map.scene import View, add_light, add_object, dull_material, set_up_rendering, temporary_scene
from .showing import scale_of

WIDTH, HEIGHT, BOTTOM = 13.0, 5.6, -2.9


def bar_colours(histogram: dict[str, Any], scale: ColourScale) -> np.ndarray[Any, Any]:
    """Return the linear colour of each bar, that of its middle, (n, 4)."""
    edges = np.array(histogram["edges"])
    return scale.colours(0.5 * (edges[1:] + edges[:-1]))


def render_histogram(measured: Distances, title: str, picture: Path) -> None:
    """Render the histogram to a PNG file, 16 by 9; the file appears when it is complete."""
    histogram, scale = measured.report["histogram"], scale_of(measured)
    counts = np.array(histogram["counts"], dtype=np.float64)
    share = counts / max(counts.max(), 1.0)
    with temporary_scene() as scene:
        view = View.three_quarter()
        set_up_rendering(scene, view, 1200)
        add_light(scene, view)
        letter = Lettering()
        x = np.linspace(-WIDTH / 2, WIDTH / 2, len(counts) + 1)
        gap = 0.05 * WIDTH / len(counts)
        corners = []
        for left, right, high in zip(x[:-1] + gap, x[1:] - gap, BOTTOM + HEIGHT * share, strict=True):
            corners += [(left, BOTTOM, 0.0), (right, BOTTOM, 0.0), (right, high, 0.0), (left, high, 0.0)]
        mesh = bpy.data.meshes.new("Bars")
        mesh.from_pydata(corners, [], [tuple(range(4 * k, 4 * k + 4)) for k in range(len(counts))])
        colours = np.repeat(bar_colours(histogram, scale), 4, axis=0)
        put(mesh.color_attributes.new("colour", "FLOAT_COLOR", "CORNER").data, "color", colours)
        mesh.materials.append(dull_material("Bars", INK, attribute="colour", shine=1.0))
        add_object(scene, "Bars", mesh, view.matrix(0.0, 0.0, 10.0))
        letter.write(title, 0.0, 3.6, 0.36)
        low, high = histogram["edges"][0], histogram["edges"][-1]
        for place in (-0.5, 0.0, 0.5):
            letter.write(f"{low + (place + 0.5) * (high - low):.3g}", place * WIDTH, BOTTOM - 0.5, 0.3)
        letter.write("distance in scene units; each bar's height is a share of the area", 0.0, BOTTOM - 1.1, 0.24)
        render_png(scene, picture, letter.shapes)

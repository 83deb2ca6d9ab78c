"""A picture of the histogram of distances: bars in the colours of the heat map."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...solver.distance.distance import Distances
from ..data.colours import ColourScale
from ..heat_map.lettering import Lettering
from ..heat_map.png import write_png
from ..heat_map.raster import draw
from .showing import scale_of

WIDTH, HEIGHT, BOTTOM = 13.0, 5.6, -2.9


def bar_colours(histogram: dict[str, Any], scale: ColourScale) -> np.ndarray[Any, Any]:
    """Return the linear colour of each bar, that of its middle, (n, 4)."""
    edges = np.array(histogram["edges"])
    return scale.colours(0.5 * (edges[1:] + edges[:-1]))


def render_histogram(measured: Distances, title: str, picture: Path) -> None:
    """Draw the histogram into a PNG file, 16 by 9; the file appears when it is complete."""
    histogram, scale = measured.report["histogram"], scale_of(measured)
    counts = np.array(histogram["counts"], dtype=np.float64)
    share = counts / max(counts.max(), 1.0)
    x = np.linspace(-WIDTH / 2, WIDTH / 2, len(counts) + 1)
    gap = 0.05 * WIDTH / len(counts)
    letter = Lettering()
    for colour, left, right, high in zip(
        bar_colours(histogram, scale), x[:-1] + gap, x[1:] - gap, BOTTOM + HEIGHT * share, strict=True
    ):
        letter.field(colour, left, right, BOTTOM, high)
    letter.write(title, 0.0, 3.6, 0.36)
    low, high = histogram["edges"][0], histogram["edges"][-1]
    for place in (-0.5, 0.0, 0.5):
        letter.write(f"{low + (place + 0.5) * (high - low):.3g}", place * WIDTH, BOTTOM - 0.5, 0.3)
    letter.write("distance in scene units; each bar's height is a share of the area", 0.0, BOTTOM - 1.1, 0.24)
    colours = np.ones((675, 1200, 3))
    draw(colours, letter.shapes)
    write_png(picture, colours)

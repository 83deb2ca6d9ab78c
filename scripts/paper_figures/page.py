"""Laying out a figure: pictures, domains and error maps side by side, saved as a small PNG file."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import ListedColormap
from numpy.typing import NDArray
from PIL import Image
from sparse_surface.operators.data.colours import linear_to_srgb, ramp

from .measurements import FIGURES

Array = NDArray[np.float64]

HEAT = ListedColormap(np.clip(linear_to_srgb(ramp()), 0.0, 1.0), name="error")
plt.rcParams.update({"font.size": 8, "axes.titlesize": 8, "font.family": "DejaVu Sans", "svg.hashsalt": "figures"})


class Page:
    """Rows and columns of panels."""

    def __init__(self, rows: int, columns: int, *, width: float = 2.1, height: float = 1.9) -> None:
        """Begin a page; measures of one panel in inches."""
        self.figure, self.axes = plt.subplots(
            rows, columns, figsize=(columns * width, rows * height + 0.3), squeeze=False, layout="constrained"
        )
        for panel in self.axes.flat:
            panel.set_axis_off()

    def picture(self, row: int, column: int, picture: Array, title: str = "") -> None:
        panel = self.axes[row, column]
        panel.imshow(picture)
        panel.set_title(title)

    def domain(self, row: int, column: int, points: Array, triangles: NDArray[np.int64], title: str = "") -> None:
        """Draw a planar triangulation; triangles that have turned over are red."""
        panel = self.axes[row, column]
        a, b, c = (points[triangles[:, k]] for k in range(3))
        flipped = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]) < 0.0
        buff = ListedColormap([(0.95, 0.86, 0.72)])
        panel.tripcolor(*points.T, triangles, facecolors=np.zeros(len(triangles)), cmap=buff)
        panel.triplot(*points.T, triangles, color=(0.35, 0.25, 0.15), linewidth=0.25)
        red = (0.85, 0.1, 0.05)
        panel.add_collection(PolyCollection(points[triangles[flipped]], facecolor=red, edgecolor=red, linewidth=0.5))
        self._fit(panel, points, title)

    def error_map(
        self,
        row: int,
        column: int,
        points: Array,
        triangles: NDArray[np.int64],
        error: Array,
        largest: float,
        title: str,
    ) -> None:
        """Colour a planar triangulation by the errors at its vertices, from 0 to `largest`."""
        panel = self.axes[row, column]
        drawn = panel.tripcolor(*points.T, triangles, error, shading="gouraud", cmap=HEAT, vmin=0, vmax=largest)
        self._fit(panel, points, title)
        self.figure.colorbar(drawn, ax=panel, shrink=0.7, format="%.2g")

    def colour_bar(self, row: int, columns: slice | int, largest: float, label: str = "error / longest side") -> None:
        """Put a scale from 0 to `largest` beside panels of a row."""
        drawn = plt.cm.ScalarMappable(plt.Normalize(0.0, largest), HEAT)
        self.figure.colorbar(drawn, ax=self.axes[row, columns], shrink=0.75, format="%.2g", label=label)

    def chart(self, row: int, column: int, title: str = "") -> Any:
        """Return a panel with axes, to be drawn on."""
        panel = self.axes[row, column]
        panel.set_axis_on()
        panel.set_title(title)
        return panel

    @staticmethod
    def _fit(panel: Any, points: Array, title: str) -> None:
        panel.set_aspect("equal")
        low, high = points.min(axis=0), points.max(axis=0)
        margin = 0.03 * (high - low).max()
        panel.set_xlim(low[0] - margin, high[0] + margin)
        panel.set_ylim(low[1] - margin, high[1] + margin)
        panel.set_title(title)

    def save(self, name: str) -> Path:
        """Write docs/figures/NAME.png without a date, beside its place and then into it."""
        FIGURES.mkdir(parents=True, exist_ok=True)
        drawn = io.BytesIO()
        self.figure.savefig(drawn, format="png", dpi=110, facecolor="white")
        plt.close(self.figure)
        path = FIGURES / f"{name}.png"
        partial = path.with_name(f".{name}.partial.png")
        Image.open(drawn).convert("RGB").save(partial, optimize=True)
        partial.replace(path)
        return path

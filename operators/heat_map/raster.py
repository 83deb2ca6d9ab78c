"""Flat shapes drawn over a picture, with smooth edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .coverage import nearest_triangles
from .scene import HEIGHT, WIDTH

FINE = 4
"""Samples of each pixel along each side."""


@dataclass(frozen=True)
class Shape:
    """Triangles (n, 3, 2) in the units of the picture, and their sRGB colour (3,)."""

    triangles: NDArray[Any]
    colour: NDArray[Any]


def draw(picture: NDArray[Any], shapes: Sequence[Shape]) -> None:
    """Draw shapes, one after the other, over sRGB values in [0, 1] (rows from the bottom, columns, 3 or more)."""
    height, width = picture.shape[:2]
    size = FINE * np.array([width, height])
    for shape in shapes:
        points = (shape.triangles / [WIDTH, HEIGHT] + 0.5) * size
        if not len(points):
            continue
        low = np.clip(points.min(axis=(0, 1)) // FINE, 0, [width, height]).astype(int)
        columns, rows = np.clip(points.max(axis=(0, 1)) // FINE + 1, 0, [width, height]).astype(int) - low
        flat = np.pad(points.reshape(-1, 2) - FINE * low, ((0, 0), (0, 1)))
        nearest, _ = nearest_triangles(flat, np.arange(len(flat)).reshape(-1, 3), FINE * columns, FINE * rows)
        share = (nearest >= 0).reshape(rows, FINE, columns, FINE).mean(axis=(1, 3))[..., None]
        part = picture[low[1] : low[1] + rows, low[0] : low[0] + columns, :3]
        part += share * (shape.colour - part)

"""Flat shapes drawn over a picture, with smooth edges: letters need no renderer, whose samples would blur them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .scene import HEIGHT, WIDTH

FINE = 4
"""Samples of each pixel along each side."""


@dataclass(frozen=True)
class Shape:
    """Triangles (n, 3, 2) in the units of the picture, and their sRGB colour (3,)."""

    triangles: NDArray[Any]
    colour: NDArray[Any]


def draw(picture: NDArray[Any], shapes: Sequence[Shape]) -> None:
    """Draw shapes, one after the other, over sRGB values in [0, 1] (rows from the bottom, columns, 4), in place."""
    height, width = picture.shape[:2]
    size = FINE * np.array([width, height])
    for shape in shapes:
        points = (shape.triangles / [WIDTH, HEIGHT] + 0.5) * size
        if not len(points):
            continue
        low = np.clip(points.min(axis=(0, 1)) // FINE, 0, [width, height]).astype(int)
        high = np.clip(points.max(axis=(0, 1)) // FINE + 1, 0, [width, height]).astype(int)
        share = _covered(points - FINE * low, *(FINE * (high - low)))
        rows, columns = high[1] - low[1], high[0] - low[0]
        mean = share.reshape(rows, FINE, columns, FINE).mean(axis=(1, 3))[..., None]
        part = picture[low[1] : high[1], low[0] : high[0], :3]
        part += mean * (shape.colour - part)


def _covered(triangles: NDArray[Any], width: int, height: int) -> NDArray[np.bool_]:
    """Return which samples (height, width) lie in one of the triangles (n, 3, 2), given in samples."""
    covered = np.zeros((height, width), dtype=bool)
    low = np.clip(np.floor(triangles.min(axis=1)), 0, [width, height]).astype(int)
    high = np.clip(np.ceil(triangles.max(axis=1)), 0, [width, height]).astype(int)
    for corners, (left, bottom), (right, top) in zip(triangles, low, high, strict=True):
        x, y = np.arange(left, right) + 0.5, (np.arange(bottom, top) + 0.5)[:, None]
        (ax, ay), (bx, by), (cx, cy) = corners.tolist()
        one = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        two = (cx - bx) * (y - by) - (cy - by) * (x - bx)
        three = (ax - cx) * (y - cy) - (ay - cy) * (x - cx)
        inside = (one >= 0.0) & (two >= 0.0) & (three >= 0.0)
        outside_in = (one <= 0.0) & (two <= 0.0) & (three <= 0.0)
        covered[bottom:top, left:right] |= inside | outside_in
    return covered

"""The nearest triangles of a mesh by the compiled kernel: `nearest.c`."""

from __future__ import annotations

from ctypes import Structure, byref, c_int64, c_void_p

import numpy as np

from ..arrays import Array, Indices
from .library import function

GROUP = 8


class _Groups(Structure):
    _fields_ = (("levels", c_int64), *((name, c_void_p) for name in ("first", "boxes", "triangles", "number")))


class Groups:
    """The triangles of a mesh, in boxes of eight, in boxes of eight of these, and so on to eight or fewer."""

    def __init__(self, corners: Array, order: Indices) -> None:
        """Take the triangles' corners, (T, 3, 3), and an order, (T,), in which neighbours mostly follow each other."""
        count = -(-len(order) // GROUP) * GROUP
        # the last triangle fills its block
        self._number = np.concatenate([order, np.repeat(order[-1:], count - len(order))])
        self._slot = np.empty_like(order)
        self._slot[order] = np.arange(len(order))
        corners = corners[self._number]
        self._triangles = _blocks(_properties(corners))
        lowest, highest = corners.min(axis=1), corners.max(axis=1)
        boxes, first = [], [0]
        while True:
            lowest = lowest.reshape(-1, GROUP, 3).min(axis=1)
            highest = highest.reshape(-1, GROUP, 3).max(axis=1)
            missing = -len(lowest) % GROUP
            lowest = np.concatenate([lowest, np.full((missing, 3), np.inf)])
            highest = np.concatenate([highest, np.full((missing, 3), -np.inf)])
            boxes.append(_blocks(np.concatenate([lowest, highest], axis=1)))
            if len(lowest) == GROUP:
                break
            first.append(first[-1] + len(lowest) // GROUP)
        self._boxes, self._first = np.concatenate(boxes), np.array(first, dtype=np.int64)

    def nearest(self, points: Array) -> tuple[Indices, Array]:
        """Nearest triangle of each point (N, 3), the first of equally near ones, (N,), and the foot on it, (N, 3)."""
        triangle = np.empty(len(points), dtype=np.int64)
        feet = self._call("nearest_triangles", points, triangle)
        return triangle, feet

    def feet(self, points: Array, triangle: Indices) -> Array:
        """Foot of each point (N, 3) on a triangle (N,) of its own, (N, 3)."""
        return self._call("feet_on_triangles", points, self._slot[triangle])

    def _call(self, name: str, points: Array, numbers: Indices) -> Array:
        """Feet of the points, from or with numbers (N,)."""
        places, feet = np.ascontiguousarray(points, dtype=np.float64), np.empty((len(points), 3))
        arrays = (self._first, self._boxes, self._triangles, self._number)
        groups = _Groups(len(self._first), *(own.ctypes.data for own in arrays))
        addresses = (c_void_p(own.ctypes.data) for own in (numbers, feet))
        function(name)(byref(groups), c_void_p(places.ctypes.data), c_int64(len(places)), *addresses)
        return feet


def _blocks(rows: Array) -> Array:
    """Rows (n, k) in blocks of eight with the eight last, (n / 8, k, 8)."""
    return np.ascontiguousarray(rows.reshape(-1, GROUP, rows.shape[1]).swapaxes(1, 2))


def _properties(corners: Array) -> Array:
    """A corner of each triangle (T, 3, 3), two sides, their products, and what divides by them, (T, 15)."""
    a, one, two = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    uu, uv, vv = ((x * y).sum(axis=1) for x, y in ((one, one), (one, two), (two, two)))
    area = uu * vv - uv * uv
    area[area <= 1e-30 * uu * vv] = 0.0  # its sides say more than its plane
    per = [np.divide(1.0, own, out=np.zeros_like(own), where=own > 0.0) for own in (uu, vv, area)]
    return np.column_stack([a, one, two, uu, uv, vv, *per])

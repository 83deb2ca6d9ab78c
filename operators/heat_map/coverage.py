"""Which of many triangles is seen at each point of a grid: a buffer of depths, filled row by row of each triangle."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]
Numbers = NDArray[np.integer[Any]]

AT_ONCE = 1 << 20
"""Points of the grid that are compared at once, and four times the triangles: bounds the memory."""

MIDDLES = np.array([0.5])


def nearest_triangles(
    points: Array, triangles: Numbers, width: int, height: int, places: Array = MIDDLES
) -> tuple[Numbers, Array]:
    """Find the triangle with the largest z at each point of a grid.

    The cells of the grid are rectangles of width and height 1 from (0, 0) on, and each row of points lies half way up
    its cells.  Triangles that share a side share no point and leave none out between them.

    Parameters
    ----------
    points
        Corners (C, 3): x, y, and z, which is larger the nearer.
    triangles
        Three corners each, (T, 3).
    places
        Where in their cells the points of a row lie, from left to right: of the first row, the second, and so on; from
        the first again after the last.

    Returns
    -------
    nearest
        The triangle at each point, (height, width), -1 where there is none.
    depth
        Its z, minus infinity where there is none.
    """
    nearest, depth = np.full(height * width, -1, dtype=np.int32), np.full(height * width, -np.inf, dtype=np.float32)
    for first in range(0, len(triangles), AT_ONCE // 4):
        corners = points[triangles[first : first + AT_ONCE // 4]].astype(np.float32)
        for triangle, at, z in _points_inside(corners, width, height, places):
            triangle = triangle + first
            while len(at):  # where several are nearer than before, the last stands, and the others try again
                nearer = z > depth[at]
                triangle, at, z = triangle[nearer], at[nearer], z[nearer]
                nearest[at], depth[at] = triangle, z
    return nearest.reshape(height, width), depth.reshape(height, width)


def _points_inside(corners: Array, width: int, height: int, places: Array) -> Iterator[tuple[Numbers, Numbers, Array]]:
    """Yield which triangle (T, 3, 3) covers which point of the grid at which z, some at a time."""
    upwards = np.argsort(corners[..., 1], axis=1)
    low, middle, high = (corners[np.arange(len(corners)), each] for each in upwards.T)
    first, past = (np.clip(_first_inside(end[:, 1], 0.5), 0, height) for end in (low, high))
    triangle, y = _counted(first, past)
    up = (y + 0.5).astype(np.float32)
    upper = np.where(up < middle[triangle, 1], 0, len(corners))
    long = _crossing(_sides(low, high)[triangle], up)
    short = _crossing(np.concatenate([_sides(low, middle), _sides(middle, high)])[triangle + upper], up)
    swapped = long[0] > short[0]
    (left, left_z), (right, right_z) = np.where(swapped, short, long), np.where(swapped, long, short)
    place = places.astype(np.float32)[y % len(places)]
    start, end = (np.clip(_first_inside(side, place), 0, width) for side in (left, right))
    rise = (right_z - left_z) / np.maximum(right - left, np.float32(1e-30))
    from_left, cell = place - left, y * width
    ends = np.cumsum(end - start)
    cuts = np.searchsorted(ends, np.arange(AT_ONCE, ends[-1] if len(ends) else 0, AT_ONCE))
    for part in np.split(np.arange(len(ends)), cuts):
        row, x = _counted(start[part], end[part])
        row = part[row]
        yield triangle[row], cell[row] + x, left_z[row] + (x.astype(np.float32) + from_left[row]) * rise[row]


def _first_inside(side: Array, place: Array | float) -> Numbers:
    """Return the first cell whose point, at a place in it, lies at or after a side."""
    return np.ceil(side - place).astype(np.int64)


def _counted(first: Numbers, past: Numbers) -> tuple[Numbers, Numbers]:
    """Return every whole number of each range, and the range it comes from: (which, number)."""
    size = np.maximum(past - first, 0)
    which = np.repeat(np.arange(len(size)), size)
    return which, np.arange(len(which)) + (first - (np.cumsum(size) - size))[which]


def _sides(low: Array, high: Array) -> Array:
    """Return each side's lower end and its slopes, (n, 5): y, x, z, and what a step up adds to x and z."""
    height = high[:, 1:2] - low[:, 1:2]
    return np.hstack([low[:, [1, 0, 2]], (high - low)[:, ::2] / np.where(height > 0.0, height, np.float32(1.0))])


def _crossing(sides: Array, up: Array) -> Array:
    """Return x and z where sides cross rows, (2, n): the same for both triangles that share a side."""
    y, x, z, more_x, more_z = sides.T
    rise = up - y
    return np.stack([x + rise * more_x, z + rise * more_z])

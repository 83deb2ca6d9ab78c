"""Draws bodies on white ground: light from above the viewer's left shoulder, hollows and the ground below darker.

Nothing is drawn at random, so that a picture needs no more points than its edges do to look smooth.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .coverage import nearest_triangles
from .scene import HEIGHT, WIDTH, Body, View

Array = NDArray[np.floating[Any]]

PLACES = np.array([0.3, 0.9, 0.5, 0.1, 0.7])
"""Points of a pixel from bottom to top, and how far right: no two on one line, and one in the middle."""

FINE = len(PLACES)

EVEN, FROM_SKY, FROM_LIGHT = 0.45, 0.25, 0.45
"""Shares of a colour that are seen in any light, that grow towards the sky, and towards the light.

A surface that faces the viewer has about its own colour, and one that faces away still nearly half: colours are
compared with the legend.
"""

LIGHT = np.array([-0.9, 1.0, 1.0]) / np.sqrt(2.81)

REACHES = (0.06, 0.15, 0.35, 0.8)
"""How far around a point it is looked for what darkens it, in units of the picture."""

DIRECTIONS = 12
HOLLOW, SHADOW = 0.6, 0.85
"""How much darker a point is that is closed in, and ground that sees nothing of the sky."""

FLAT = 0.05
"""How far surfaces may bend towards each other, as a sine, before they darken: facets shall not be seen more."""

CELLS, MOST_CELLS = 12.0, 600.0
"""Of the ground's shadow in a unit, and along its longer side: what points at the viewer may be very long."""

MARGIN = 8.0
LEVELS = (0.02, 0.06, 0.15, 0.3, 0.5, 0.75, 0.999)
"""Heights, as shares of a body's, at which its cross-sections shade the ground."""


def draw_bodies(canvas: Array, bodies: list[Body], view: View, ground: float) -> None:
    """Draw bodies, which hide nothing of each other, over linear values (rows from the bottom, columns, 3), in place.

    Parameters
    ----------
    bodies
        In the picture's axes.
    ground
        Height of the ground above (0, 0, 0), upright in the world.
    """
    for body in bodies:
        _shade_ground(canvas, body, view, ground)
    for body in bodies:
        if len(body.triangles):
            _draw(canvas, body, view, ground)


# -------------------------------------------------------------------------------------------------------------- bodies


def _draw(canvas: Array, body: Body, view: View, ground: float) -> None:
    unit, size = canvas.shape[1] / WIDTH, np.array(canvas.shape[1::-1])
    corners = body.vertices[body.corner_vertices].astype(np.float32)
    pixels = (corners[:, :2] / [WIDTH, HEIGHT] + 0.5) * size
    low = np.clip(np.floor(pixels.min(axis=0)), 0, size).astype(int)
    columns, rows = np.clip(np.ceil(pixels.max(axis=0)), 0, size).astype(int) - low
    on_grid = np.column_stack([(pixels - low) * [1, FINE], corners[:, 2]])
    nearest, depth = nearest_triangles(on_grid, body.triangles, columns, FINE * rows, PLACES)
    facing = _facing(corners[body.triangles])
    lit = body.colours[body.triangles] * _light(_turned_to(facing, body.normals[body.triangles]), view)[..., None]
    means = _seen(lit, on_grid[body.triangles], nearest).reshape(rows, FINE, columns, 3).mean(axis=1)
    share = (nearest >= 0).reshape(rows, FINE, columns, 1).mean(axis=1, dtype=np.float32)
    middles = np.s_[FINE // 2 :: FINE]
    around = _surroundings(depth[middles], (low + 0.5) / unit - np.array([WIDTH, HEIGHT]) / 2, unit, view, ground)
    shade = 1.0 - HOLLOW * _closed_in(depth[middles], facing[nearest[middles]], around, unit)
    part = canvas[low[1] : low[1] + rows, low[0] : low[0] + columns]
    part *= 1.0 - share
    part += means * shade[..., None]


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)
    return unit


def _facing(corners: Array) -> Array:
    """Return the unit normals of triangles (T, 3, 3) on that side which the viewer sees, (T, 3)."""
    normals = _unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    return np.where(normals[:, 2:] < 0.0, -normals, normals)


def _turned_to(facing: Array, normals: Array) -> Array:
    """Return unit normals of triangles' corners, (T, 3, 3), on the side of the triangles' own (T, 3)."""
    same_side = np.einsum("tci,ti->tc", normals, facing)[..., None] >= 0.0
    return _unit(np.where(same_side, normals, -normals)).astype(np.float32)


def _light(normals: Array, view: View) -> Array:
    """Return how bright surfaces with unit normals (..., 3) are."""
    sky, light = (direction.astype(np.float32) for direction in (view.axes[:, 2], LIGHT))
    return EVEN + FROM_SKY * (0.5 + 0.5 * normals @ sky) + FROM_LIGHT * np.maximum(normals @ light, 0.0)


def _seen(values: Array, corners: Array, nearest: NDArray[np.integer[Any]]) -> Array:
    """Return what is seen at the points of the grid, (rows, columns, 3), zero where there is nothing.

    Between the corners of triangles (T, 3, 3), where `values` (T, 3, 3) are given, it changes evenly.
    """
    y, x = np.nonzero(nearest >= 0)
    own = nearest[y, x]
    first, b, c = corners[:, 0, :2], corners[:, 1, :2] - corners[:, 0, :2], corners[:, 2, :2] - corners[:, 0, :2]
    area = b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0]
    shares = np.stack([c[:, 1], -c[:, 0], -b[:, 1], b[:, 0]]) / np.where(area == 0.0, 1.0, area)
    start_x, start_y, bx, by, cx, cy = np.vstack([first.T, shares]).astype(np.float32).T[own].T
    right, up = (x + PLACES[y % FINE]).astype(np.float32) - start_x, (y + 0.5).astype(np.float32) - start_y
    to_b, to_c = (np.clip(one * right + other * up, 0.0, 1.0)[:, None] for one, other in ((bx, by), (cx, cy)))
    start, at_b, at_c = values.astype(np.float32).transpose(1, 0, 2)
    seen = np.zeros((*nearest.shape, 3), dtype=np.float32)
    seen[y, x] = start[own] + to_b * (at_b - start)[own] + to_c * (at_c - start)[own]
    return seen


def _surroundings(depth: Array, start: Array, unit: float, view: View, ground: float) -> Array:
    """Return the depth of pixels, of the ground where no body is seen, with a rim as wide as the largest reach."""
    rim = int(np.ceil(max(REACHES) * unit))
    height, width = (side + 2 * rim for side in depth.shape)
    x, y = (at + (np.arange(side) - rim) / unit for at, side in zip(start, (width, height), strict=True))
    right, up, out = view.axes[:, 2]
    far = np.full((height, width), -1e3)
    around: Array = (ground - right * x - up * y[:, None]) / out if out > 1e-3 else far
    part = around[rim:-rim, rim:-rim]
    part[:] = np.where(np.isfinite(depth), depth, part)
    return around.astype(np.float32)


def _closed_in(depth: Array, normals: Array, around: Array, unit: float) -> Array:
    """Return how much of what each pixel of a body faces is hidden by what is near, from 0 to 1 (rows, columns)."""
    rim = (around.shape[0] - depth.shape[0]) // 2
    rows, columns = np.nonzero(np.isfinite(depth))
    at, every = (rows + rim) * around.shape[1] + columns + rim, around.ravel()
    (a, b, c), z = normals[rows, columns].T, depth[rows, columns]
    hidden = np.zeros(len(at), dtype=np.float32)
    for angle in 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
        highest = np.zeros_like(hidden)
        for reach in REACHES:
            i, j = (round(reach * unit * part) for part in (np.cos(angle), np.sin(angle)))
            x, y, rise = i / unit, j / unit, every[at + j * around.shape[1] + i] - z
            distance = np.sqrt(np.float32(max(x * x + y * y, 1e-12)) + rise * rise)
            nearness = 1.0 / (1.0 + (distance / max(REACHES)) ** 2)
            np.maximum(highest, ((a * x + b * y + c * rise) / distance - FLAT) * nearness, out=highest)
        hidden += highest / DIRECTIONS
    values = np.zeros(depth.shape, dtype=np.float32)
    values[rows, columns] = hidden
    return _smoothed(values, np.isfinite(depth))


def _smoothed(values: Array, known: NDArray[np.bool_]) -> Array:
    """Return the mean of the known values in the nine pixels around each."""
    height, width = values.shape
    both = np.pad(np.stack([values * known, known.astype(np.float32)]), ((0, 0), (1, 1), (1, 1)))
    total, count = np.sum([both[:, j : j + height, i : i + width] for j in range(3) for i in range(3)], axis=0)
    return total / np.maximum(count, 1.0)


# -------------------------------------------------------------------------------------------------------------- ground


def _shade_ground(canvas: Array, body: Body, view: View, ground: float) -> None:
    """Darken the ground by what a body hides of an evenly bright sky."""
    right, up, out = view.axes[:, 2]
    if out < 1e-3 or not len(body.triangles):  # seen from below
        return
    upright = body.vertices @ view.axes
    start = upright[:, :2].min(axis=0) - MARGIN
    cells = min(CELLS, MOST_CELLS / float((upright[:, :2].max(axis=0) + MARGIN - start).max()))
    hidden = _hidden_sky(upright[body.corner_vertices] - [*start, ground], body.triangles, cells)
    x, y = (
        side * ((np.arange(count) + 0.5) / count - 0.5)
        for side, count in ((WIDTH, canvas.shape[1]), (HEIGHT, canvas.shape[0]))
    )
    # The place on the ground, in its cells, of each pixel: sums of what column and row make of it.
    of_x, of_y = view.axes[0, :2] - right / out * view.axes[2, :2], view.axes[1, :2] - up / out * view.axes[2, :2]
    first = ground / out * view.axes[2, :2] - start
    i, j = ((cells * (first[k] + of_x[k] * x + (of_y[k] * y)[:, None]) - 0.5).astype(np.float32) for k in (0, 1))
    canvas *= 1.0 - SHADOW * _looked_up(hidden, i, j)[..., None]


def _hidden_sky(points: Array, triangles: NDArray[np.integer[Any]], cells: float) -> Array:
    """Return which share of the sky is hidden from places of the ground, weighted by the cosine to the upright.

    A flat shape at height h hides from a place of the ground the integral over it of h^2 / (pi (h^2 + r^2)^2), r being
    the distance along the ground.  Of a body's cross-sections the one that hides most counts, which is exact beside a
    thick wall.
    """
    width, height = (int(cells * (points[:, k].max() + MARGIN)) + 1 for k in (0, 1))
    over = [nearest_triangles(points * [cells, cells, sign], triangles, width, height)[1] for sign in (1.0, -1.0)]
    highest, lowest = over[0], -over[1]
    x, y = (np.minimum(np.arange(side), side - np.arange(side)) / cells for side in (width, height))
    r2 = x * x + (y * y)[:, None]
    hidden = np.zeros((height, width))
    for level in max(float(points[:, 2].max()), 1e-3) * np.array(LEVELS):
        section = np.fft.rfft2((lowest <= level) & (highest >= level))
        kernel = (level / (level * level + r2)) ** 2
        np.maximum(hidden, np.fft.irfft2(section * np.fft.rfft2(kernel / kernel.sum()), s=r2.shape), out=hidden)
    fading_x, fading_y = (
        np.clip(np.minimum(np.arange(side), side - 1 - np.arange(side)) / (0.5 * cells * MARGIN), 0.0, 1.0)
        for side in (width, height)
    )
    return hidden * fading_x * fading_y[:, None]


def _looked_up(cells: Array, x: Array, y: Array) -> Array:
    """Return values between the middles of cells, which have whole numbers, zero outside."""
    inside = (x >= 0.0) & (y >= 0.0) & (x < cells.shape[1] - 1) & (y < cells.shape[0] - 1)
    x, y = x[inside], y[inside]
    i, j = x.astype(int), y.astype(int)
    every, at, right = cells.astype(np.float32).ravel(), j * cells.shape[1] + i, x - i
    low, high = (every[row] + right * (every[row + 1] - every[row]) for row in (at, at + cells.shape[1]))
    found = np.zeros(inside.shape, dtype=np.float32)
    found[inside] = low + (y - j) * (high - low)
    return found

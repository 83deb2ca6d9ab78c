"""Triangles and quads split as Blender splits them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def cut_quads(
    positions: NDArray[np.float32], corners: NDArray[np.int32], sizes: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Split triangles and quads as Blender does.

    A quad (0, 1, 2, 3) becomes (0, 1, 2) and (0, 2, 3), or (0, 1, 3) and (1, 2, 3) if the line from 0 to 2 leaves it.

    Parameters
    ----------
    positions
        (V, 3), as Blender stores them: in another frame the line may leave another quad.
    corners
        (C,) vertex of each polygon corner, polygon after polygon.
    sizes
        (F,) number of corners of each polygon, 3 or 4.

    Returns
    -------
    Vertices of the triangles, (T, 3), and the polygon of each, (T,).
    """
    if np.all(sizes == 3):
        return corners.reshape(-1, 3), np.arange(len(sizes), dtype=np.int32)
    starts = np.cumsum(sizes) - sizes
    first = starts - 2 * np.arange(len(sizes))  # a polygon has two triangles fewer than corners
    polygons = np.repeat(np.arange(len(sizes), dtype=np.int32), sizes - 2)
    triangles = np.empty((len(polygons), 3), dtype=np.int32)
    triangles[first] = corners.take(starts[:, None] + np.arange(3))
    is_quad = sizes == 4
    quads, first = corners.take(starts[is_quad, None] + np.arange(4)), first[is_quad]
    leaves = _first_cut_leaves(positions, quads)
    triangles[first, 2] = np.where(leaves, quads[:, 3], quads[:, 2])
    triangles[first + 1] = quads[:, 1:]
    triangles[first + 1, 0] = np.where(leaves, quads[:, 1], quads[:, 0])
    return triangles, polygons


def _first_cut_leaves(positions: NDArray[np.float32], quads: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Whether the line from 0 to 2 leaves a quad, (Q,): (p1 - p0) x (p2 - p0) . (p3 - p0) x (p2 - p0) > 0."""
    corners = (axis.take(quads.T) for axis in positions.T)
    with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is refused later, in a sentence
        x, y, z = (axis[1:] - axis[0] for axis in corners)
        normals = [(a[0] * b[1] - b[0] * a[1]) * (a[2] * b[1] - b[2] * a[1]) for a, b in ((y, z), (z, x), (x, y))]
        return normals[0] + normals[1] + normals[2] > 0.0

"""Fewer triangles for a picture of a mesh: vertex clustering.

Space is divided into equal cubes, of the vertices in one cube the one nearest to their mean is kept, and of the
triangles those that still have three different corners (J. Rossignac, P. Borrel, "Multi-resolution 3D approximations
for rendering complex scenes", 1993).  It is quick and keeps places, not topology: what is solved never sees it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Indices
from .normals import triangle_areas

SAMPLE = 100_000
"""Triangles from which the area is estimated; reading all of a large mesh would take longer."""

MARGIN = 1.05
"""Where there are still too many triangles, a cube's side grows by this factor more than seems needed."""


def coarsen(vertices: ArrayLike, triangles: ArrayLike, most: int) -> tuple[Indices, Indices]:
    """Return a coarser mesh on some of the vertices.

    Parameters
    ----------
    vertices
        Positions, (V, 3), scene units.
    triangles
        Corners, (T, 3).
    most
        Most triangles of the result; a mesh with at most this many stays unchanged.

    Returns
    -------
    kept : (W,) integers
        The vertices that are kept, in ascending order.
    coarse : (S, 3) integers
        Triangles on the kept vertices, each once and turned as in the mesh.
    """
    corners = np.asarray(triangles, dtype=np.int64).reshape(-1, 3)
    places = np.asarray(vertices, dtype=np.float64)
    if len(corners) <= most:
        return np.arange(len(places)), corners
    stride = -(-len(corners) // SAMPLE)
    area = stride * float(triangle_areas(places, corners[::stride]).sum())
    places = places - places.min(axis=0)  # a cube at a corner of the mesh can grow to hold it all
    # A surface passes through about one cube for each face of a cube that it could cover, with two triangles.
    side = np.sqrt(2.0 * area / most) or float(np.ptp(places)) / most or 1.0
    while True:  # ends: the cubes grow until one holds the whole mesh
        kept, cluster = _clusters(places, side)
        coarse = _each_once(cluster[corners])
        if len(coarse) <= most:
            return kept, coarse
        side *= MARGIN * np.sqrt(len(coarse) / most)


def _clusters(places: Array, side: float) -> tuple[Indices, Indices]:
    """Return the vertex that is kept of each occupied cube, (W,), in ascending order, and each vertex's row, (V,)."""
    nearest, number = one_in_each_cell(places, side)
    order = np.argsort(nearest)
    row = np.empty_like(order)
    row[order] = np.arange(len(order))
    return nearest[order], row[number]


def _each_once(corners: Indices) -> Indices:
    """Return the triangles with three different corners, each once in whatever order its corners are, (S, 3)."""
    ordered = np.sort(corners, axis=1)
    proper = (ordered[:, 0] < ordered[:, 1]) & (ordered[:, 1] < ordered[:, 2])
    _, first = np.unique(one_number(ordered[proper]), return_index=True)
    return corners[proper][np.sort(first)]


def one_in_each_cell(points: Array, cell: float) -> tuple[Indices, Indices]:
    """Choose in each cell of a grid the point that is nearest to the mean there.

    Parameters
    ----------
    points
        (n, 3), at least one.
    cell
        Length of a cell's sides.

    Returns
    -------
    chosen : (W,) integers
        Which points are chosen, in the order of the cells.
    number : (n,) integers
        Each point's cell, as a row of `chosen`.
    """
    cells = np.floor(points / cell).astype(np.int64)
    _, number, count = np.unique(one_number(cells - cells.min(axis=0)), return_inverse=True, return_counts=True)
    means = np.stack([np.bincount(number, weights=column) for column in points.T], axis=1) / count[:, None]
    order = np.lexsort((((points - means[number]) ** 2).sum(axis=1), number))
    return order[np.cumsum(count) - count], number


def one_number(rows: Indices) -> Indices:
    """Return a number for each row of three that are not negative, (n,), which come in the order of the rows."""
    if not len(rows):
        return np.arange(0)
    widths = [int(width) for width in rows.max(axis=0) + 1]
    if widths[0] * widths[1] * widths[2] >= 2**63:
        return np.unique(rows, axis=0, return_inverse=True)[1].reshape(-1)
    return (rows[:, 0] * widths[1] + rows[:, 1]) * widths[2] + rows[:, 2]

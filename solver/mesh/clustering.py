"""Fewer triangles for a picture of a mesh: vertex clustering.

Space is divided into equal cubes, of the vertices in one cube the one nearest to their mean is kept, and of the
triangles those that still have three different corners (J. Rossignac, P. Borrel, "Multi-resolution 3D approximations
for rendering complex scenes", 1993).  It is quick and keeps places, not topology: what is solved never sees it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Indices
from .grid_cells import one_in_each_cell, one_number
from .triangulation import triangle_areas

SAMPLE = 100_000
"""From so many triangles the area is estimated, for which the memory of a large mesh is not walked through."""

MARGIN = 1.05
"""By so much more than seems needed a cube grows, in length, where there are too many triangles still."""


def coarsen(vertices: ArrayLike, triangles: ArrayLike, most: int) -> tuple[Indices, Indices]:
    """Return a coarser mesh on some of the vertices.

    Parameters
    ----------
    vertices
        Positions, (V, 3), scene units.
    triangles
        Corners, (T, 3).
    most
        How many triangles there may be; with no more than that the mesh stays as it is.

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
    while True:  # with larger cubes each time, until it is all in one at the latest
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

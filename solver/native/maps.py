"""Patches laid flat by the compiled kernel: `parameterisation.c`."""

from __future__ import annotations

from ctypes import Structure, byref, c_int64, c_void_p
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Booleans, Indices
from .library import function


class Disks(NamedTuple):
    """K patches, each a disk, in ragged arrays.

    Attributes
    ----------
    vertex_offsets, positions
        Their vertices, (K + 1,) and (M, 3).
    triangle_offsets, triangles
        Their triangles as numbers of vertices within the patch, (K + 1,) and (S, 3).
    lengths, areas
        Of the sides opposite to each corner, (S, 3), and of the triangles, (S,).
    """

    vertex_offsets: Indices
    positions: Array
    triangle_offsets: Indices
    triangles: Indices
    lengths: Array
    areas: Array


class _Maps(Structure):
    _fields_ = (
        ("patches", c_int64),
        *((name, c_void_p) for name in ("offsets", "triangle_offsets", "positions", "triangles", "lengths", "areas")),
        *((name, c_void_p) for name in ("points", "solved")),
    )


def conformal_maps(disks: Disks) -> tuple[Array, Booleans]:
    """Least squares conformal maps with two vertices of the border held, as `patches.parameterisation` has them.

    Returns
    -------
    points, solved
        Plane points of the vertices, (M, 2), and which patches were mapped, (K,): rounding can make a system
        indefinite, and large ones are left to a general factorisation.  Points of the others are zero.
    """
    points = np.zeros((len(disks.positions), 2))
    solved = np.zeros(len(disks.vertex_offsets) - 1, dtype=np.uint8)
    whole = (disks.vertex_offsets, disks.triangle_offsets, disks.triangles)
    offsets, triangle_offsets, triangles = (np.ascontiguousarray(own, dtype=np.int64) for own in whole)
    real = (disks.positions, disks.lengths, disks.areas)
    positions, lengths, areas = (np.ascontiguousarray(own, dtype=np.float64) for own in real)
    arrays = offsets, triangle_offsets, positions, triangles, lengths, areas, points, solved
    maps = _Maps(len(solved), *(array.ctypes.data for array in arrays))
    if function("conformal_maps")(byref(maps)):
        raise MemoryError("There is not enough memory to map the patches to the plane.")
    return points, solved.astype(bool)

"""Tables of patch triangles: which patch vertices their corners are, and which lie over each mesh triangle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ..arrays import Booleans, Indices, rows_at, rows_in_order, runs_of_rows
from ..native.surface import Holders

TRIANGLES_AT_ONCE = 20_000
"""Patch triangles that are numbered together: more would leave the cache."""


def corners_in_order(
    patch_triangles: Indices,
    vertices: tuple[Indices, Indices],
    offsets: Indices,
    mesh_triangles: Indices,
    triangles: Indices,
) -> NDArray[np.int32]:
    """Patch vertices, counted over all patches, at the corners of the patch triangles, (S, 3).

    Parameters
    ----------
    patch_triangles
        Corners as numbers within their patch, (S, 3), in any order.
    vertices
        Where the vertices of each patch begin, (K + 1,), and the mesh vertex that each patch vertex is, (M,).
    offsets, mesh_triangles
        Where the triangles of each patch begin, (K + 1,), and the mesh triangle that each is, (S,).
    triangles
        The mesh vertices in the order that is wanted, (T, 3).
    """
    (starts, names), table = vertices, np.empty(patch_triangles.shape, dtype=np.int32)
    for first, end in runs_of_rows(offsets, TRIANGLES_AT_ONCE):
        rows = slice(*offsets[[first, end]])
        own = patch_triangles[rows] + np.repeat(starts[first:end], np.diff(offsets[first : end + 1]))[:, None]
        table[rows] = rows_in_order(own, rows_at(names, own), rows_at(triangles, mesh_triangles[rows]))
    return table


def holders_of(weighty: Booleans, offsets: Indices, mesh_triangles: Indices, count: int) -> Holders:
    """Which of the `weighty` patch triangles, (S,), lie over each of `count` mesh triangles."""
    own = np.flatnonzero(weighty)
    shape = len(offsets) - 1, count
    by_patch = csr_array((own, mesh_triangles[own], np.searchsorted(own, offsets)), shape=shape)
    by_triangle = by_patch.tocsc()  # sorts by counting
    held, patch = (array.astype(np.int32, copy=False) for array in (by_triangle.data, by_triangle.indices))
    return Holders(by_triangle.indptr.astype(np.int64), held, patch)

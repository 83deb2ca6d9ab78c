"""Growing one-sided patches by the compiled kernel, `patch_growth.c`, and what patches are listed as."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import Structure, byref, c_double, c_int64, c_void_p
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Booleans, Indices
from .library import function


class Listed(NamedTuple):
    """P patches in rows as long as the longest, padded with -1.

    Attributes
    ----------
    triangles
        From the seed outwards, (P, K).
    vertices
        In the order in which the triangles' corners name them last, (P, L).
    corner_places
        Where in `vertices`, flattened, each triangle corner stands; one patch after the other.
    """

    triangles: Indices
    vertices: Indices
    corner_places: Indices


class _Growth(Structure):
    _fields_ = (
        *((name, c_int64) for name in ("patches", "room")),
        ("least_cosine", c_double),
        *((name, c_void_p) for name in ("corners", "neighbours", "normals", "members")),
        *((name, c_void_p) for name in ("sizes", "outermost", "waiting", "triangle_mark", "vertex_mark")),
    )


class NativeGrowth:
    """Patches that grow together; see `denoising.patch_growth.PlainGrowth`, which does the same.

    Parameters
    ----------
    triangles
        Vertices of the corners, (T, 3).
    vertex_count
        Of the mesh.
    neighbours, normals, least_cosine
        As in `denoising.patch_growth.GrowingPatches`.
    largest
        Most triangles that a patch will be asked to have.
    most_rings
        How many rings a patch of so many triangles may have.
    """

    def __init__(
        self,
        triangles: Indices,
        vertex_count: int,
        neighbours: Indices,
        normals: Array,
        least_cosine: float,
        largest: int,
        most_rings: Callable[[int], int],
    ) -> None:
        self._mesh = (
            *(np.ascontiguousarray(own, dtype=np.int64) for own in (triangles, neighbours)),
            np.ascontiguousarray(normals, dtype=np.float64),
        )
        self._marks = np.zeros(len(triangles), dtype=np.int32), np.zeros(vertex_count, dtype=np.int32)
        self._least_cosine, self._most_rings = least_cosine, most_rings
        self._room = 4 * largest  # the ring after the last has at most three times as many
        self.begin(np.zeros(0, dtype=np.int64))

    def begin(self, seeds: Indices) -> None:
        """Start again with patches of one triangle each, (P,)."""
        count = len(seeds)
        self._members = np.empty((count, self._room), dtype=np.int64)
        self._members[:, 0] = seeds
        self.sizes, outermost = np.ones(count, dtype=np.int64), np.ones(count, dtype=np.int64)
        self._rings = 0
        self._states = (self._members, self.sizes, outermost, np.zeros(count, dtype=np.int64))
        arrays: tuple[NDArray[Any], ...] = (*self._mesh, *self._states, *self._marks)
        self._own = _Growth(count, self._room, self._least_cosine, *(array.ctypes.data for array in arrays))

    def grow(self, limit: int, wanted: Booleans) -> None:
        """Let the patches that are `wanted`, (P,), grow to at most `limit` triangles."""
        grow, chosen = function("grow_patches"), np.ascontiguousarray(wanted, dtype=np.uint8)
        grow.restype = c_int64
        most = max(self._most_rings(limit) - self._rings, 0)
        self._rings += int(grow(byref(self._own), _at(chosen), c_int64(limit), c_int64(most)))

    def listed(self, wanted: Booleans) -> Listed:
        """Return the `wanted` patches, (P,)."""
        which = wanted.nonzero()[0].astype(np.int64, copy=False)
        sizes = self.sizes[which]
        shape = len(which), int(sizes.max(initial=0))
        triangles, corner_places = np.empty(shape, dtype=np.int64), np.empty(3 * int(sizes.sum()), dtype=np.int64)
        space = np.empty(3 * triangles.size, dtype=np.int64)  # room that nothing is written to takes no memory
        arrays = _at(triangles), _at(space), _at(corner_places)
        run = function("list_patches")
        run.restype = c_int64
        longest = int(run(byref(self._own), _at(which), c_int64(shape[0]), c_int64(shape[1]), *arrays))
        return Listed(triangles, space[: shape[0] * longest].reshape(shape[0], longest), corner_places)


def _at(array: NDArray[Any]) -> c_void_p:
    return c_void_p(array.ctypes.data)

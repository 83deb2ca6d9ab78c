"""What known values suggest for the next ones, by the compiled kernel: `predicted.c`."""

from __future__ import annotations

from ctypes import Structure, byref, c_int64, c_void_p
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from .library import function


class _Round(Structure):
    _fields_ = (*((name, c_int64) for name in ("links", "owners")), *((name, c_void_p) for name in ("link", "owner")))


def _means(name: str, used: Indices, owner: Indices, count: int, width: int, *given: Any) -> Array:
    link, whose = (np.ascontiguousarray(part, dtype=np.int64) for part in (used, owner))
    round_ = _Round(len(link), count, link.ctypes.data, whose.ctypes.data)
    mean = np.empty((count, width))
    if function(name)(byref(round_), *given, _address(mean)):
        raise MemoryError("There is not enough memory to read the file.")
    return mean


def _address(array: NDArray[Any]) -> c_void_p:
    return c_void_p(array.ctypes.data)


class Parallelograms:
    """Links (Q, 4) of corners target, a, b, c: `surface.format.positions` says what they suggest."""

    def __init__(self, links: NDArray[np.int32]) -> None:
        self.links = np.ascontiguousarray(links, dtype=np.int32)

    def means(self, positions: Array, sizes: Array, used: Indices, owner: Indices, count: int) -> Array:
        """Means of the suggestions and of the sizes, (count, 6), over the links that each owner has.

        Parameters
        ----------
        positions, sizes
            (V, 3), contiguous.
        used, owner
            Which links, (q,), and whose, (q,) below `count`.
        """
        given = (_address(part) for part in (self.links, positions, sizes))
        return _means("positions_across", used, owner, count, 6, *given)


class _Unfolded(Structure):
    _fields_ = (
        *((name, c_int64) for name in ("patch_triangles", "mesh_triangles")),
        *((name, c_void_p) for name in ("link", "triangle", "share", "height")),
    )


class UnfoldedTriangles:
    """Patch triangles (S, 3), their mesh triangles (S,), and the shapes of these, (3, T) both.

    Link k S + s leads to corner k of patch triangle s; `surface.format.domains` says what it suggests.  `links` are
    target and sources of each, (3 S, 3).
    """

    def __init__(self, corners: Indices, triangles: Indices, share: Array, height: Array) -> None:
        self.links = np.empty((3 * len(corners), 3), dtype=np.int32)
        for side, rows in enumerate(np.split(self.links, 3)):
            for k in range(3):
                rows[:, k] = corners[:, (side + k) % 3]
        shapes = [np.ascontiguousarray(part, dtype=np.float64) for part in (share, height)]
        self._kept: list[NDArray[Any]] = [self.links, np.ascontiguousarray(triangles, dtype=np.int64), *shapes]
        addresses = (part.ctypes.data for part in self._kept)
        self.own = _Unfolded(len(corners), share.shape[1], *addresses)

    def means(self, domain: Array, off: Array, sizes: Array, used: Indices, owner: Indices, count: int) -> Array:
        """Means of the suggestions, of what the ends are off by, and of the sizes, (count, 5).

        `domain`, `off` and `sizes` are (M, 2), contiguous; the rest is as for `Parallelograms`.
        """
        given = (byref(self.own), *(_address(part) for part in (domain, off, sizes)))
        return _means("domains_across", used, owner, count, 5, *given)

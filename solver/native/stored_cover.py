"""The cover of a file, found again by the compiled kernel: `stored_cover.c`, and numbers of nodes by `disks.c`."""

from __future__ import annotations

from ctypes import Structure, byref, c_int64, c_void_p
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Indices
from .disks import Members, Numbered, Surface
from .graphs import Graph
from .library import function


class _Rings(Structure):
    _fields_ = (
        ("count", c_int64),
        *((name, c_void_p) for name in ("centre", "radius")),
        ("room", c_int64),
        *((name, c_void_p) for name in ("size", "triangle")),
        ("done", c_int64),
    )


class Fans(NamedTuple):
    """Triangles (T, 3) of nodes; `triangles[offsets[n]:offsets[n + 1]]` are those around node n."""

    corners: Indices
    offsets: Indices
    triangles: Indices

    def surface(self) -> Surface:
        """The same as the kernel takes it for disks."""
        none = np.zeros((0, 3), dtype=np.int64)
        nowhere = Graph(np.zeros(1, dtype=np.int64), np.zeros(0, dtype=np.int32))
        return Surface(nowhere, self.offsets, self.triangles, self.corners, none, none, *(none[:, k] for k in range(3)))

    def rings(self, centres: Indices, radii: Indices, room: int) -> tuple[Indices, Indices]:
        """Grow rings as long as they have no more than `room` triangles together.

        Returns
        -------
        sizes, triangles
            How many triangles touch the (radius - 1)-ring of each centre, for as many centres as there is room for;
            and these triangles, one ring after the other, ascending.
        """
        own = [np.ascontiguousarray(part, dtype=np.int64) for part in (centres, radii)]
        sizes, triangles = np.empty(len(centres), dtype=np.int64), np.empty(room, dtype=np.int64)
        addresses = (part.ctypes.data for part in (*own, sizes, triangles))
        centre, radius, size, triangle = addresses
        rings = _Rings(len(centres), centre, radius, room, size, triangle, 0)
        self.surface().run("grow_rings", byref(rings))
        sizes = sizes[: rings.done]
        return sizes, triangles[: int(sizes.sum())]


def numbered_nodes(nodes: Indices, count: int, members: Members) -> Numbered:
    """Number those of `count` nodes, (T, 3), that patches have; their `rim_distance` means nothing."""
    nothing = np.zeros(count + 1, dtype=np.int64)
    return Fans(nodes, nothing, nothing[:0]).surface().numbered(members)


def hops_in_patches(offsets: Indices, corners: Indices, distance: Indices) -> None:
    """Find edges to the nearest vertices of the same patch.

    Parameters
    ----------
    offsets, corners
        Where each patch's triangles begin, (K + 1,), and their corners, counted over all patches, (S, 3).
    distance
        0 where hops begin and -1 elsewhere, (M,); becomes the distance where there is one.
    """
    own = [np.ascontiguousarray(part, dtype=np.int64) for part in (offsets, corners)]
    addresses = (c_void_p(part.ctypes.data) for part in (*own, distance))
    function("hops_in_patches")(c_int64(len(offsets) - 1), *addresses)


def shares_nearby(weights: Array, corners: Indices) -> Array:
    """The larger of each weight, (M,), and half of the largest in a triangle, (S, 3), that it belongs to."""
    own, given = np.ascontiguousarray(corners, dtype=np.int64), np.ascontiguousarray(weights, dtype=np.float64)
    shares = given.copy()
    function("shares_nearby")(c_int64(len(own)), *(c_void_p(part.ctypes.data) for part in (own, given, shares)))
    return shares

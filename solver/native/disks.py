"""Rings of triangles around centres, and which of them are disks, by the compiled kernel: `disks.c`."""

from __future__ import annotations

from ctypes import Structure, byref, c_int64, c_void_p
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Booleans, Indices, offsets_of
from .graphs import Graph
from .library import function


class _Surface(Structure):
    _fields_ = (
        *((name, c_int64) for name in ("nodes", "triangles", "edges", "holes")),
        *((name, c_void_p) for name in ("offsets", "neighbours", "fan_offsets", "fan_triangles", "corners")),
        *((name, c_void_p) for name in ("triangle_edges", "ends", "hole", "hole_sides", "twin")),
    )


class _Members(Structure):
    _fields_ = (("count", c_int64), ("offsets", c_void_p), ("triangles", c_void_p))


class _Numbered(Structure):
    _fields_ = tuple((name, c_void_p) for name in ("sizes", "nodes", "rim_distance", "corners"))


class Members(NamedTuple):
    """K sets of triangles: those of set k are `triangles[offsets[k]:offsets[k + 1]]`, ascending."""

    offsets: Indices
    triangles: Indices


class Numbered(NamedTuple):
    """Nodes of K patches.

    Attributes
    ----------
    sizes
        How many each patch has, (K,).
    nodes, rim_distance
        One patch after the other, ascending, which they are, and how many edges each is from the rim, (M,); one where
        there is no rim.
    corners
        The triangles' corners as numbers within their patch, (S, 3).
    """

    sizes: Indices
    nodes: Indices
    rim_distance: Indices
    corners: Indices


@dataclass(frozen=True)
class Surface:
    """The topology of a mesh of N nodes, T triangles and E edges, as in `mesh.triangle_mesh.TriangleMesh`.

    Attributes
    ----------
    graph
        Which nodes share an edge.
    fan_offsets, fan_triangles
        Triangles around each node.
    corners, triangle_edges
        Nodes and edges of each triangle, (T, 3) both.
    edges
        Nodes of each edge, (E, 2).
    hole, hole_sides
        Hole of the mesh that each edge lies on, (E,), -1 on most, and the number of edges around each.
    twin
        First edge between the same nodes where there are more, else -1, (E,).
    """

    graph: Graph
    fan_offsets: Indices
    fan_triangles: Indices
    corners: Indices
    triangle_edges: Indices
    edges: Indices
    hole: Indices
    hole_sides: Indices
    twin: Indices

    def rings(self, centres: Indices, radius: int) -> Members:
        """The triangles that touch the (radius - 1)-ring of each centre."""
        return self.members(centres, radius, self.ring_sizes(centres, radius))

    def ring_sizes(self, centres: Indices, radius: int) -> Indices:
        """How many triangles these are, (K,)."""
        starts, sizes = np.ascontiguousarray(centres, dtype=np.int64), np.empty(len(centres), dtype=np.int64)
        self.run("ring_sizes", _at(starts), c_int64(len(starts)), c_int64(radius), _at(sizes))
        return sizes

    def members(self, centres: Indices, radius: int, sizes: Indices) -> Members:
        """The triangles themselves, for the sizes that `ring_sizes` returned."""
        starts = np.ascontiguousarray(centres, dtype=np.int64)
        found = Members(offsets_of(sizes), np.empty(int(sizes.sum()), dtype=np.int64))
        self.run("ring_members", _at(starts), c_int64(radius), byref(_native(found)))
        return found

    def are_disks(self, members: Members) -> Booleans:
        """Which patches are disks, (K,)."""
        good = np.zeros(len(members.offsets) - 1, dtype=np.uint8)
        self.run("judge_disks", byref(_native(members)), _at(good))
        return good.astype(bool)

    def grown(self, centres: Indices, radius: int, most: Indices, wanted: Booleans) -> tuple[Members, Indices]:
        """Grow a disk around each centre (see `patches.strips`); also returns their radii, 0 where there is none."""
        starts, limits = (np.ascontiguousarray(own, dtype=np.int64) for own in (centres, most))
        first, room = np.ascontiguousarray(wanted, dtype=np.uint8), np.empty(len(starts), dtype=np.int64)
        self.run("ring_sizes", _at(starts), c_int64(len(starts)), c_int64(radius), _at(room))
        space = Members(offsets_of(room), np.empty(int(room.sum()), dtype=np.int64))
        sizes, radii = np.empty_like(room), np.empty_like(room)
        given = _at(starts), c_int64(radius), _at(limits), _at(first), byref(_native(space))
        self.run("grow_disks", *given, _at(sizes), _at(radii))
        used = np.arange(len(space.triangles)) - np.repeat(space.offsets[:-1], room) < np.repeat(sizes, room)
        return Members(offsets_of(sizes), space.triangles[used]), radii

    def held(self, members: Members) -> Booleans:
        """The nodes that some patch has with all of their triangles, (N,)."""
        held = np.zeros(len(self.fan_offsets) - 1, dtype=np.uint8)
        self.run("mark_held", byref(_native(members)), _at(held))
        return held.astype(bool)

    def numbered(self, members: Members) -> Numbered:
        """Number the nodes of each patch."""
        size = len(members.triangles)
        # room that nothing is written to takes no memory
        nodes, distance, corners = (np.empty(3 * size, dtype=np.int64) for _ in range(3))
        sizes = np.empty(len(members.offsets) - 1, dtype=np.int64)
        arrays = _Numbered(*(array.ctypes.data for array in (sizes, nodes, distance, corners)))
        self.run("number_nodes", byref(_native(members)), byref(arrays))
        count = int(sizes.sum())
        return Numbered(sizes, nodes[:count].copy(), distance[:count].copy(), corners.reshape(-1, 3))

    def run(self, name: str, *arguments: Any) -> None:
        """Call a function of the kernel on the mesh."""
        arrays: tuple[NDArray[Any], ...] = (
            np.ascontiguousarray(self.graph.offsets, dtype=np.int64),
            np.ascontiguousarray(self.graph.neighbours, dtype=np.int32),
            *(np.ascontiguousarray(own, dtype=np.int64) for own in (self.fan_offsets, self.fan_triangles)),
            *(np.ascontiguousarray(own, dtype=np.int64) for own in (self.corners, self.triangle_edges, self.edges)),
            *(np.ascontiguousarray(own, dtype=np.int64) for own in (self.hole, self.hole_sides, self.twin)),
        )
        counts = len(self.fan_offsets) - 1, len(self.corners), len(self.edges), len(self.hole_sides)
        if function(name)(byref(_Surface(*counts, *(array.ctypes.data for array in arrays))), *arguments):
            raise MemoryError("There is not enough memory to make patches.")


def _at(array: NDArray[Any]) -> c_void_p:
    return c_void_p(array.ctypes.data)


def _native(members: Members) -> _Members:
    return _Members(len(members.offsets) - 1, members.offsets.ctypes.data, members.triangles.ctypes.data)

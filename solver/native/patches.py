"""Covers chosen and patches laid flat by the compiled kernel: `cover.c` and `parameterisation.c`."""

from __future__ import annotations

from ctypes import Structure, byref, c_int64, c_void_p
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Booleans, Indices
from .library import function

NO_PATH = np.iinfo(np.int32).max
"""Hops between nodes that no path joins."""


class Graph(NamedTuple):
    """The neighbours of node n are `neighbours[offsets[n]:offsets[n + 1]]`."""

    offsets: NDArray[np.integer[Any]]
    neighbours: NDArray[np.integer[Any]]


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


class _Graph(Structure):
    _fields_ = (("nodes", c_int64), ("offsets", c_void_p), ("neighbours", c_void_p))


class _Maps(Structure):
    _fields_ = (
        ("patches", c_int64),
        *((name, c_void_p) for name in ("offsets", "triangle_offsets", "positions", "triangles", "lengths", "areas")),
        *((name, c_void_p) for name in ("points", "solved")),
    )


def _run(name: str, what: str, *arguments: Any) -> None:
    if function(name)(*arguments):
        raise MemoryError(f"There is not enough memory to {what}.")


def _address(array: NDArray[Any]) -> c_void_p:
    return c_void_p(array.ctypes.data)


def hops_from(graph: Graph, sources: Indices) -> Indices:
    """Number of edges from each node to the nearest source, (N,); `NO_PATH` where there is no path."""
    count = len(graph.offsets) - 1
    offsets, neighbours = _plain(graph)
    starts, hops = np.ascontiguousarray(sources, dtype=np.int32), np.empty(count, dtype=np.int32)
    own = _Graph(count, offsets.ctypes.data, neighbours.ctypes.data)
    _run("hops_from", "cover the mesh", byref(own), _address(starts), c_int64(len(starts)), _address(hops))
    return hops.astype(np.int64)


def farthest_points(
    graph: Graph, wanted: Booleans, first: Indices, rank: Indices, ring: int, one_at_a_time: int
) -> Indices:
    """Choose centres from the `first` ones on, as `patches.cover.build_cover` does.

    Parameters
    ----------
    wanted, rank
        Which nodes are to be covered, and which of equals comes first, (N,) both.
    ring
        Centres are added until no wanted node is as far from them.
    one_at_a_time
        Beyond as many hops centres are added one at a time.
    """
    count, total = len(rank), c_int64()
    offsets, neighbours = _plain(graph)
    covered, ranks = np.ascontiguousarray(wanted, dtype=np.uint8), np.ascontiguousarray(rank, dtype=np.int32)
    centres = np.empty(count, dtype=np.int32)
    centres[: len(first)] = first
    own = _Graph(count, offsets.ctypes.data, neighbours.ctypes.data)
    numbers = c_int64(ring), c_int64(one_at_a_time), _address(centres), c_int64(len(first)), byref(total)
    _run("farthest_points", "cover the mesh", byref(own), _address(covered), _address(ranks), *numbers)
    return centres[: total.value].astype(np.int64)


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
    _run("conformal_maps", "map the patches to the plane", byref(maps))
    return points, solved.astype(bool)


def _plain(graph: Graph) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    return (
        np.ascontiguousarray(graph.offsets, dtype=np.int64),
        np.ascontiguousarray(graph.neighbours, dtype=np.int32),
    )

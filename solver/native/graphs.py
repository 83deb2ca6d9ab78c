"""Walks through graphs by the compiled kernel, and orders of their edges: `cover.c`, `parts.c` and `order.c`."""

from __future__ import annotations

from ctypes import Structure, byref, c_int64, c_void_p
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Booleans, Indices
from .library import function

NO_PATH = np.iinfo(np.int32).max
"""Hops between nodes that no path joins."""


class Graph(NamedTuple):
    """The neighbours of node n are `neighbours[offsets[n]:offsets[n + 1]]`."""

    offsets: NDArray[np.integer[Any]]
    neighbours: NDArray[np.integer[Any]]


class _Graph(Structure):
    _fields_ = (("nodes", c_int64), ("offsets", c_void_p), ("neighbours", c_void_p))


def _run(name: str, *arguments: Any) -> None:
    if function(name)(*arguments):
        raise MemoryError("There is not enough memory to cover the mesh.")


def _address(array: NDArray[Any]) -> c_void_p:
    return c_void_p(array.ctypes.data)


def hops_from(graph: Graph, sources: Indices) -> Indices:
    """Number of edges from each node to the nearest source, (N,); `NO_PATH` where there is no path."""
    count = len(graph.offsets) - 1
    offsets, neighbours = _plain(graph)
    starts, hops = np.ascontiguousarray(sources, dtype=np.int32), np.empty(count, dtype=np.int32)
    own = _Graph(count, offsets.ctypes.data, neighbours.ctypes.data)
    _run("hops_from", byref(own), _address(starts), c_int64(len(starts)), _address(hops))
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
    _run("farthest_points", byref(own), _address(covered), _address(ranks), *numbers)
    return centres[: total.value].astype(np.int64)


def _plain(graph: Graph) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    return (
        np.ascontiguousarray(graph.offsets, dtype=np.int64),
        np.ascontiguousarray(graph.neighbours, dtype=np.int32),
    )


def connected_parts(one: Indices, other: Indices, count: int) -> tuple[int, Indices]:
    """Parts that edges leave of `count` nodes, and each node's, as `mesh.edges.connected_parts` numbers them."""
    starts, ends = (np.ascontiguousarray(own, dtype=np.int64) for own in (one, other))
    part, joined = np.empty(count, dtype=np.int64), function("connected_parts")
    joined.restype = c_int64
    found = joined(_address(starts), _address(ends), c_int64(len(starts)), c_int64(count), _address(part))
    return int(found), part


def stable_order(numbers: Indices) -> Indices:
    """Order in which whole numbers from 0 on ascend, equal ones as they come, as `mesh.edges.stable_order`."""
    keys, order = np.ascontiguousarray(numbers, dtype=np.int64), np.empty(len(numbers), dtype=np.int64)
    _run("stable_order", _address(keys), c_int64(len(keys)), _address(order))
    return order

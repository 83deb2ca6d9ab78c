"""Undirected edges as single numbers, and the parts of a graph that edges connect."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..arrays import Indices
from ..native import graphs
from ..native.library import reason_against


def edge_keys(one: Indices, other: Indices, vertex_count: int) -> Indices:
    """Return one number for each pair of vertices, the same in both directions, ascending with the smaller vertex."""
    keys: Indices = np.minimum(one, other) * np.int64(vertex_count) + np.maximum(one, other)
    return keys


def stable_order(numbers: Indices) -> Indices:
    """Return `numpy.argsort(numbers, kind="stable")` of whole numbers from 0 on, by counting digits."""
    return graphs.stable_order(numbers) if reason_against() is None else np.argsort(numbers, kind="stable")


def connected_parts(one: Indices, other: Indices, count: int) -> tuple[int, Indices]:
    """Return how many parts the edges from `one` to `other`, (E,) each, leave of `count` nodes, and each node's part.

    Parts are numbered by their lowest node.
    """
    if reason_against() is None:
        return graphs.connected_parts(one, other, count)
    graph = coo_array((np.ones(len(one), dtype=np.int8), (one, other)), shape=(count, count)).tocsr()
    parts, part = connected_components(graph, directed=False)
    return int(parts), part.astype(np.int64)

"""Cover of a mesh by k-rings: farthest-point sampling in edge hops (paper, section 5)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Booleans, Indices, row_positions
from ..mesh.triangle_mesh import TriangleMesh
from ..native import graphs as native
from ..native.library import reason_against

_FAR = np.iinfo(np.int64).max
_HUB = 100  # more neighbours than this make a node a hub
_ONE_AT_A_TIME = 32  # beyond this many hops there are few centres, placed one at a time


def build_cover(mesh: TriangleMesh, ring: int, wanted: Booleans | None = None) -> Indices:
    """Choose centres so that each wanted node lies in the (ring - 1)-ring of one of them.

    Farthest-point sampling in edge hops: the next centre is always a node at the greatest distance from all centres.
    Nodes at that distance which are as far from each other are taken in one round, which gives what one at a time
    would give.  Ties are broken by a fixed scrambling of the node number: the same mesh has the same cover.

    Parameters
    ----------
    mesh
        The mesh.
    ring
        Radius of the patches, in edges; at least 1.
    wanted
        Nodes to be covered, (N,); when not given, all but those of vertices that are passed through.

    Returns
    -------
    Nodes of the centres, (K,), in the order of choice.
    """
    offsets, neighbours = mesh.adjacency.indptr.astype(np.int64), mesh.adjacency.indices
    wanted = ~mesh.passed_through[mesh.node_vertex] if wanted is None else wanted
    if not wanted.any():
        return np.zeros(0, dtype=np.int64)
    rank = _scrambled(mesh.node_count)
    chosen = [_first_centres(mesh, wanted)]
    if reason_against() is None:
        return native.farthest_points(_graph(mesh), wanted, chosen[0], rank, max(ring, 1), _ONE_AT_A_TIME)
    distance = np.where(wanted, _FAR, -1)
    _lower(distance, offsets, neighbours, chosen[0])
    while True:
        farthest = int(distance.max())
        if farthest < max(ring, 1):
            return np.concatenate(chosen)
        candidates = np.flatnonzero(distance == farthest)
        if farthest > _ONE_AT_A_TIME:
            centres = candidates[np.argmax(rank[candidates])][None]
        else:
            centres = _mutually_distant(candidates, farthest, rank, offsets, neighbours)
        chosen.append(centres)
        _lower(distance, offsets, neighbours, centres)


def hops_from(mesh: TriangleMesh, sources: Indices) -> Indices:
    """Return the number of edges from each node to the nearest source, (N,); `_FAR` where there is no path."""
    if reason_against() is None:
        hops = native.hops_from(_graph(mesh), sources)
        return np.where(hops == native.NO_PATH, _FAR, hops)
    distance = np.full(mesh.node_count, _FAR)
    _lower(distance, mesh.adjacency.indptr.astype(np.int64), mesh.adjacency.indices, sources)
    return distance


def _graph(mesh: TriangleMesh) -> native.Graph:
    return native.Graph(mesh.adjacency.indptr, mesh.adjacency.indices)


def _first_centres(mesh: TriangleMesh, wanted: Booleans) -> Indices:
    """Return the hubs of each component, or else its node that is farthest from its first wanted node.

    A patch that reaches a hub holds all its neighbours, so each of them as a centre would cost as much as the hub: the
    patches round a pole of n triangles would have n^2 in all.
    """
    nodes = np.flatnonzero(wanted)
    hubs = nodes[np.diff(mesh.adjacency.indptr)[nodes] > _HUB]
    nodes = nodes[~np.isin(mesh.component[nodes], mesh.component[hubs])]
    _, first = np.unique(mesh.component[nodes], return_index=True)
    distance = hops_from(mesh, nodes[first])[nodes]
    order = np.lexsort((nodes, -distance, mesh.component[nodes]))
    _, best = np.unique(mesh.component[nodes][order], return_index=True)
    return np.concatenate([hubs, nodes[order[best]]])


def gather_neighbours(
    offsets: Indices, neighbours: NDArray[np.integer[Any]], nodes: Indices
) -> tuple[Indices, Indices]:
    """Return all neighbours of `nodes`, one after the other, and for each the position in `nodes` it belongs to."""
    rows, new = row_positions(offsets, nodes)
    return neighbours[rows].astype(np.int64), np.repeat(np.arange(len(nodes)), np.diff(new))


def _lower(distance: Indices, offsets: Indices, neighbours: NDArray[np.integer[Any]], sources: Indices) -> None:
    """Lower `distance` in place to the hops from `sources`; paths may pass nodes at -1, which keep their value."""
    reached = distance
    walls = distance < 0
    if walls.any():
        reached = np.where(walls, _FAR, distance)
    reached[sources] = 0
    tag = np.empty(len(distance), dtype=np.int64)
    front, step = sources, 0
    while len(front):
        step += 1
        nearby, _ = gather_neighbours(offsets, neighbours, front)
        nearby = nearby[reached[nearby] > step]
        reached[nearby] = step
        front = _once(nearby, tag)
    if reached is not distance:
        distance[:] = np.where(walls, -1, reached)


def _mutually_distant(
    candidates: Indices, hops: int, rank: Indices, offsets: Indices, neighbours: NDArray[np.integer[Any]]
) -> Indices:
    """Return the candidates that outrank every other candidate within less than `hops` edges."""
    if len(candidates) == 1:
        return candidates
    tag = np.empty(len(offsets) - 1, dtype=np.int64)
    highest = np.full(len(offsets) - 1, -1, dtype=np.int64)
    highest[candidates] = rank[candidates]
    front = candidates
    for _ in range(hops - 1):
        nearby, owner = gather_neighbours(offsets, neighbours, front)
        value = highest[front][owner]
        better = value > highest[nearby]
        nearby, value = nearby[better], value[better]
        if len(nearby) == 0:
            break
        np.maximum.at(highest, nearby, value)
        front = _once(nearby, tag)
    return candidates[highest[candidates] == rank[candidates]]


def _once(nodes: Indices, tag: Indices) -> Indices:
    """Return each node once; `tag` (N,) is scratch space.  Unlike sorting this takes linear time."""
    number = np.arange(len(nodes))
    tag[nodes] = number
    return nodes[tag[nodes] == number]


def _scrambled(count: int) -> Indices:
    """Return a fixed permutation of 0 .. count - 1 without the order that node numbers have along a mesh."""
    number = np.arange(count, dtype=np.uint64)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        number = (number ^ (number >> np.uint64(shift))) * np.uint64(factor)
    rank = np.empty(count, dtype=np.int64)
    rank[np.argsort(number, kind="stable")] = np.arange(count)
    return rank

"""Disks that grow node by node where a ring closes around something thin: strips of tubes, bars and walls.

A ring that goes around a tube is none of a disk's size; the rings that are would hold a vertex or two each.  A disk
that takes in one node after the other, with all of its triangles, and leaves out those that would close it, is as long
as a ring and as wide as a disk can be.

A triangle leaves a disk a disk where it joins it at one edge and its third corner is new, or at two edges whose
third one is new.  This is the plain version of what `native/strips.c` does.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from ..arrays import Booleans, Indices, offsets_of
from ..mesh.triangle_mesh import TriangleMesh


def grown_by_numpy(
    mesh: TriangleMesh, centres: Indices, ring: int, most: Indices, wanted: Booleans
) -> tuple[Indices, Indices, Indices]:
    """Grow a disk around each of K centres, within its ring.

    Parameters
    ----------
    most
        How many triangles each may have, (K,), unless a single node has more.
    wanted
        Nodes to be taken in first among those equally far from the centre, (N,).

    Returns
    -------
    offsets, triangles
        Triangles of disk k, ascending, are `triangles[offsets[k]:offsets[k + 1]]`.
    radii
        Of the disks, in edges, (K,); 0 where there is none.
    """
    disks = [_Strip(mesh, int(limit)) for limit in most]
    radii = [disk.grow(int(centre), ring, wanted) for disk, centre in zip(disks, centres, strict=True)]
    sizes = np.array([len(disk.triangles) for disk in disks], dtype=np.int64)
    none = np.zeros(0, dtype=np.int64)
    triangles = np.concatenate([none, *(np.sort(np.array(disk.triangles, dtype=np.int64)) for disk in disks)])
    return offsets_of(sizes), triangles, np.array(radii, dtype=np.int64)


class _Strip:
    """One disk while it grows: its triangles in order, and how many are at each node, edge and pair of twins."""

    def __init__(self, mesh: TriangleMesh, most: int) -> None:
        self.triangles: list[int] = []
        self._mesh, self._most = mesh, most
        self._inside: set[int] = set()
        self._at_node: Counter[int] = Counter()
        self._at_edge: Counter[int] = Counter()
        self._at_twin: Counter[int] = Counter()

    def grow(self, centre: int, ring: int, wanted: Booleans) -> int:
        """Grow around a node; returns the radius in edges, 0 where its triangles are not a disk."""
        if not self._hold(centre):
            return 0
        graph, front, seen, reached = self._mesh.adjacency, [centre], {centre}, 1
        for step in range(2, ring + 1):
            beside = [int(n) for node in front for n in graph.indices[graph.indptr[node] : graph.indptr[node + 1]]]
            met = [node for node in dict.fromkeys(beside) if node not in seen]
            seen.update(met)
            front = [node for node in sorted(met, key=lambda node: not wanted[node]) if self._hold(node)]
            if not front:
                break
            reached = step
        return reached

    def _hold(self, node: int) -> bool:
        """Take in all triangles around a node, or none."""
        bounds = self._mesh.fan_offsets
        fan = [int(triangle) for triangle in self._mesh.fan_triangles[bounds[node] : bounds[node + 1]]]
        missing, before = [triangle for triangle in fan if triangle not in self._inside], len(self.triangles)
        if missing and before and before + len(missing) > self._most:
            return False
        more = True
        while more:
            more = False
            for triangle in missing:
                if triangle not in self._inside and (not self.triangles or self._fits(triangle)):
                    self._change(triangle, 1)
                    more = True
        if len(self.triangles) == before + len(missing):
            return True
        while len(self.triangles) > before:
            self._change(self.triangles[-1], -1)
        return False

    def _fits(self, triangle: int) -> bool:
        edges = self._mesh.triangle_edges[triangle]
        joined = [self._at_edge[edge] > 0 for edge in edges]
        if sum(joined) == 1:
            return not self._at_node[self._mesh.nodes[triangle, (joined.index(True) + 2) % 3]]
        return sum(joined) == 2 and not self._at_twin[self._mesh.twin_of_edge[edges[joined.index(False)]]]

    def _change(self, triangle: int, by: int) -> None:
        if by > 0:
            self.triangles.append(triangle)
            self._inside.add(triangle)
        else:
            self._inside.remove(self.triangles.pop())
        for corner in range(3):
            edge = self._mesh.triangle_edges[triangle, corner]
            self._at_node[self._mesh.nodes[triangle, corner]] += by
            self._at_edge[edge] += by
            if self._mesh.twin_of_edge[edge] >= 0:
                self._at_twin[self._mesh.twin_of_edge[edge]] += by

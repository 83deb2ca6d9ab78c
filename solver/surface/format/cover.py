"""The cover, found again from the mesh: rings around centres, distances to rims, and the weights made of them.

This is the format's own definition (docs/format.md); it does not change when the solver learns to cover better.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, vstack

from ...arrays import Array, Booleans, Indices, offsets_of
from ...mesh.edges import stable_order
from ...native.disks import Members
from ...native.library import reason_against
from ...native.stored_cover import Fans, hops_in_patches, numbered_nodes
from ..container import demand

POWER, HIDING = 1.5, 1000.0
"""Weights before they are divided by their sum: distance to the rim to this power, times this base to the level."""

AT_ONCE = 2_000_000
"""Entries of the rings that grow together; bounds the memory."""


@dataclass(frozen=True)
class Incidence:
    """Which triangles touch which of N nodes: `triangles[offsets[n]:offsets[n + 1]]`, ascending.

    One that names a node twice touches none.
    """

    nodes: Indices
    offsets: Indices
    triangles: Indices

    @classmethod
    def of(cls, nodes: Indices, count: int) -> Incidence:
        """Find them for triangles, (T, 3), that name `count` nodes."""
        a, b, c = nodes.T
        proper = (a != b) & (b != c) & (c != a)
        corners = np.arange(nodes.size) if proper.all() else np.flatnonzero(np.repeat(proper, 3))
        own = nodes.ravel()[corners]
        return cls(nodes, offsets_of(np.bincount(own, minlength=count)), corners[stable_order(own)] // 3)

    @cached_property
    def of_nodes(self) -> csr_array:
        """The same as a matrix, (N, T) boolean."""
        ones = np.ones(len(self.triangles), dtype=bool)
        return csr_array((ones, self.triangles, self.offsets), shape=(len(self.offsets) - 1, len(self.nodes)))

    @cached_property
    def reach(self) -> csr_array:
        """Which nodes share a triangle, (N, N) boolean."""
        of_nodes = self.of_nodes.astype(np.int32)
        reach = csr_array(of_nodes @ of_nodes.T)
        reach.data = reach.data.astype(bool)
        return reach


def ring_members(incidence: Incidence, centres: Indices, rings: Indices, most: int) -> csr_array:
    """Triangles that touch the (ring - 1)-ring of each centre, (K, T) boolean; none where the ring is 0.

    Raises
    ------
    Refusal
        When they are more than `most`.
    """
    parts, held, first = [csr_array((0, len(incidence.nodes)), dtype=bool)], 0, 0
    grow = _grown if reason_against() else _grown_natively
    while first < len(centres):
        part = grow(incidence, centres[first:], rings[first:], most - held)
        parts.append(part)
        held, first = held + part.nnz, first + part.shape[0]
    members = csr_array(vstack(parts, format="csr"))
    members.sort_indices()
    return members


def _grown_natively(incidence: Incidence, centres: Indices, rings: Indices, most: int) -> csr_array:
    """Return the members of the first rings, as many as may grow together."""
    each = len(incidence.nodes)
    fans = Fans(incidence.nodes, incidence.offsets, incidence.triangles)
    sizes, members = fans.rings(centres, rings, min(most, max(AT_ONCE, each)))
    demand(len(sizes), "its patches are larger than it says")
    return csr_array((np.ones(len(members), dtype=bool), members, offsets_of(sizes)), shape=(len(sizes), each))


def _grown(incidence: Incidence, centres: Indices, rings: Indices, most: int) -> csr_array:
    """The same by NumPy."""
    together = max(AT_ONCE // max(len(incidence.nodes), 1), 64)
    centres, rings = centres[:together], rings[:together]
    rows = np.flatnonzero(rings > 0)
    ball = csr_array(
        (np.ones(len(rows), dtype=bool), (rows, centres[rows])), shape=(len(centres), incidence.reach.shape[0])
    )
    for step in range(1, int(rings.max(initial=0))):
        grown = csr_array(ball @ incidence.reach)
        still = rings > step
        ball = grown if still.all() else _chosen(still, grown, ball)
        demand(ball.nnz <= 3 * most, "its patches are larger than it says")
    members = csr_array(ball @ incidence.of_nodes)
    demand(members.nnz <= most, "its patches are larger than it says")
    return members


def _chosen(which: Booleans, one: csr_array, other: csr_array) -> csr_array:
    """Rows of one matrix where `which`, of the other elsewhere."""
    parts = []
    for matrix, rows in ((one, which), (other, ~which)):
        keep = np.repeat(rows, np.diff(matrix.indptr))
        parts.append(
            csr_array(
                (matrix.data[keep], matrix.indices[keep], offsets_of(np.where(rows, np.diff(matrix.indptr), 0))),
                shape=matrix.shape,
            )
        )
    return csr_array(parts[0] + parts[1])


@dataclass(frozen=True)
class Cover:
    """Patches in ragged arrays: nodes (M,), ascending in each patch; corners as positions in them (S, 3)."""

    vertex_offsets: Indices
    nodes: Indices
    triangle_offsets: Indices
    mesh_triangles: Indices
    corners: Indices

    @property
    def patch_of_vertex(self) -> Indices:
        """Patch of each of `nodes`, (M,)."""
        return np.repeat(np.arange(len(self.vertex_offsets) - 1), np.diff(self.vertex_offsets))

    @classmethod
    def of(cls, nodes: Indices, count: int, triangle_offsets: Indices, mesh_triangles: Indices) -> Cover:
        """Number the vertices of patches that hold the given triangles of a mesh with `count` nodes."""
        if not reason_against():
            found = numbered_nodes(nodes, count, Members(triangle_offsets, mesh_triangles))
            first = offsets_of(found.sizes)
            own = found.corners + np.repeat(first[:-1], np.diff(triangle_offsets))[:, None]
            return cls(first, found.nodes, triangle_offsets, mesh_triangles, own)
        patches = len(triangle_offsets) - 1
        patch = np.repeat(np.arange(patches), np.diff(triangle_offsets))
        own = nodes[mesh_triangles]
        ones = np.ones(own.size, dtype=np.int8)
        members = csr_array((ones, own.ravel(), 3 * triangle_offsets), shape=(patches, count)).astype(np.int32)
        members.sum_duplicates()
        keys = np.repeat(np.arange(patches), np.diff(members.indptr)) * np.int64(count) + members.indices
        corners = np.searchsorted(keys, (patch[:, None] * np.int64(count) + own).ravel()).reshape(-1, 3)
        offsets = members.indptr.astype(np.int64)
        return cls(offsets, members.indices.astype(np.int64), triangle_offsets, mesh_triangles, corners)

    def rim(self, incidence: Incidence) -> Booleans:
        """Tell which patch vertices, (M,), have a triangle outside of their patch."""
        around = np.bincount(self.corners.ravel(), minlength=len(self.nodes))
        on_rim: Booleans = around < np.diff(incidence.offsets)[self.nodes]
        return on_rim

    def hops(self, start: Booleans) -> Indices:
        """Edges from each patch vertex to the nearest of its patch where `start`, (M,); -1 where there is none."""
        reached, distance = start.copy(), np.where(start, 0, -1)
        if not reason_against():
            hops_in_patches(self.triangle_offsets, self.corners, distance)
            return distance
        waiting, step = np.ascontiguousarray(self.corners.T), 0
        while waiting.size:
            step += 1
            at = reached[waiting]
            some = at[0] | at[1] | at[2]
            found = waiting[:, some][~at[:, some]]
            if not len(found):
                break
            distance[found] = step
            reached[found] = True
            waiting = waiting[:, ~some]
        return distance

    def rim_distances(self, incidence: Incidence) -> Indices:
        """Edges from each patch vertex to the rim, (M,); 1 in a patch without rim."""
        distance = self.hops(self.rim(incidence))
        distance[distance < 0] = 1
        return distance


def weights_of(cover: Cover, vertices: Indices, depth: Indices, levels: Indices, passed: Booleans, kind: str) -> Array:
    """Blending weights of vertices at `depth`, (M,) all, in patches of `levels` (K,); none where `passed` (V,)."""
    raw = np.ones(len(vertices))
    if kind == "partition":
        raw = depth.astype(np.float64) ** POWER * HIDING ** levels[cover.patch_of_vertex].astype(np.float64)
    raw[passed[vertices]] = 0.0
    # each side of a crease sums to one by itself
    total = np.bincount(cover.nodes, weights=raw)
    return np.divide(raw, total[cover.nodes], out=np.zeros_like(raw), where=raw > 0.0)

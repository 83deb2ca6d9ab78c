"""Boundaries of patches as ordered loops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Booleans, Indices, offsets_of
from ..mesh.edges import connected_parts
from .patches import Patches


@dataclass(frozen=True, eq=False)
class Loops:
    """Closed loops of patch vertices.

    Attributes
    ----------
    offsets, vertices
        Loop `i` runs through `vertices[offsets[i]:offsets[i + 1]]`, positions in `Patches.vertices`, in the direction
        of the patch's orientation and from its lowest; (L + 1,) and (B,).
    patch
        Patch of each loop, (L,), ascending.
    """

    offsets: Indices
    vertices: Indices
    patch: Indices

    @property
    def following(self) -> Indices:
        """The next vertex on the loop for each entry of `vertices`, (B,)."""
        following = np.roll(self.vertices, -1)
        following[self.offsets[1:] - 1] = self.vertices[self.offsets[:-1]]
        return following

    def select(self, which: Booleans) -> Loops:
        """Return some of the loops."""
        sizes = np.diff(self.offsets)
        return Loops(offsets_of(sizes[which]), self.vertices[np.repeat(which, sizes)], self.patch[which])


def boundary_loops(patches: Patches) -> tuple[Loops, Loops]:
    """Return the outer boundary of each patch, one loop a patch, and the loops around small holes of the mesh."""
    start, end = _boundary_sides(patches.block_triangles, len(patches.vertices))
    on_loop = np.sort(start)
    position = np.full(len(patches.vertices), -1, dtype=np.int64)
    position[on_loop] = np.arange(len(on_loop))
    following = np.empty(len(on_loop), dtype=np.int64)
    following[position[start]] = position[end]
    loops = _ordered(on_loop, following, patches.vertex_patch[on_loop])
    sizes = np.diff(loops.offsets)
    order = np.lexsort((-sizes, loops.patch))
    outer = np.zeros(len(sizes), dtype=bool)
    outer[order[np.concatenate(([True], loops.patch[order][1:] != loops.patch[order][:-1]))[: len(order)]]] = True
    return loops.select(outer), loops.select(~outer)


def _boundary_sides(triangles: Indices, vertex_count: int) -> tuple[Indices, Indices]:
    """Return start and end of the triangle sides that have no opposite side."""
    start, end = triangles.reshape(-1), np.roll(triangles, -1, axis=1).reshape(-1)
    ones = np.ones(len(start), dtype=np.int8)
    sides = csr_array((ones, (start, end)), shape=(vertex_count, vertex_count))
    alone = (sides - sides.T).tocoo()
    rows, columns = alone.coords
    kept = alone.data > 0
    return rows[kept].astype(np.int64), columns[kept].astype(np.int64)


def _ordered(vertices: Indices, following: Indices, patch: Indices) -> Loops:
    """Turn a permutation that leads from each vertex to the next into loops."""
    count = len(vertices)
    # Loops are numbered by their lowest vertex and vertices sorted by patch, so loops are sorted by patch too.
    _, loop = connected_parts(np.arange(count), following, count)
    _, first, sizes = np.unique(loop, return_index=True, return_counts=True)
    offsets = offsets_of(sizes)
    result = np.empty(count, dtype=np.int64)
    result[offsets[loop] + _rank_in_cycle(following, first[loop])] = vertices
    return Loops(offsets, result, patch[first])


def _rank_in_cycle(following: Indices, first: Indices) -> Indices:
    """Return how many steps each element is behind the first of its cycle, by doubling the step."""
    count = len(following)
    preceding = np.empty(count, dtype=np.int64)
    preceding[following] = np.arange(count)
    own = np.arange(count)
    jump = np.where(own == first, own, preceding)
    rank = (own != first).astype(np.int64)
    while True:
        further = rank + rank[jump]
        if np.array_equal(further, rank):
            return rank
        rank, jump = further, jump[jump]

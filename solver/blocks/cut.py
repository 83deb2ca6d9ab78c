"""Where a mesh is cut into blocks, and what each block is given to work on.

The vertices are halved along the longest side of their box until blocks have the wanted size; ties go by the order
along earlier cuts.  That depends on nothing but the positions and the size.  A block is solved with a *halo*: all
vertices up to some number of steps away, a step leading from a vertex to those that share a face with it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ..arrays import Indices, offsets_of, row_positions
from ..settings import Settings
from .large_mesh import ROWS_AT_ONCE, LargeMesh, narrow_type, parts_of
from .scratch import Allocate, in_memory
from .task import BlockTask

FRONT_AT_ONCE = 1 << 14
"""Vertices whose faces are looked up together."""


@dataclass(frozen=True, eq=False)
class Cut:
    """B blocks.

    Attributes
    ----------
    order, offsets
        Block b has the vertices `order[offsets[b]:offsets[b + 1]]`, (V,) and (B + 1,).
    block
        Block of each vertex, (V,).
    """

    order: NDArray[np.integer[Any]]
    offsets: Indices
    block: NDArray[np.int32]

    @classmethod
    def of(cls, mesh: LargeMesh, size: int) -> Cut:
        """Cut a mesh into blocks of at most `size` vertices, as equal as can be."""
        positions, count = mesh.positions, -(-len(mesh.positions) // size)
        order: NDArray[np.integer[Any]] = np.arange(len(positions), dtype=narrow_type(len(positions)))
        offsets, ahead = np.zeros(count + 1, dtype=np.int64), [(0, len(positions), 0, count)]
        while ahead:
            start, end, first, blocks = ahead.pop()
            if blocks == 1:
                offsets[first + 1] = end
                continue
            own: NDArray[np.integer[Any]] = order[start:end]
            along = positions[own, _longest_axis(positions, own)]
            order[start:end] = own[np.argsort(along, kind="stable")]
            left = blocks // 2
            middle = start + (end - start) * left // blocks
            ahead += [(start, middle, first, left), (middle, end, first + left, blocks - left)]
        block = np.empty(len(positions), dtype=np.int32)
        block[order] = np.repeat(np.arange(count, dtype=np.int32), np.diff(offsets))
        return cls(order, offsets, block)

    def __len__(self) -> int:
        return len(self.offsets) - 1


def _longest_axis(positions: NDArray[np.floating[Any]], vertices: NDArray[np.integer[Any]]) -> int:
    """Axis along which the box around some vertices is longest, the first of equal ones."""
    low, high = np.full(3, np.inf, positions.dtype), np.full(3, -np.inf, positions.dtype)
    for part in parts_of(vertices):
        points = positions[part]
        low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    return int(np.argmax(high - low))


@dataclass(frozen=True, eq=False)
class Part:
    """A block with its halo: n vertices and f faces.

    Attributes
    ----------
    vertices, faces
        Their numbers in the mesh, ascending, (n,) and (f,).
    first_triangles
        Number of each face's first triangle, (f,).
    corners, sizes
        The faces' corners as positions in `vertices`, one face after the other, and how many each has: one number
        where all have as many.
    """

    vertices: Indices
    faces: Indices
    first_triangles: Indices
    corners: NDArray[np.int32]
    sizes: NDArray[np.int32] | int

    @property
    def offsets(self) -> Indices:
        """Where each face's corners begin, (f + 1,)."""
        if isinstance(self.sizes, int):
            return np.arange(0, len(self.corners) + 1, self.sizes)
        return offsets_of(self.sizes.astype(np.int64))

    def triangle_numbers(self, polygon: Indices) -> Indices:
        """Return the numbers of triangles in the mesh from the faces of the part that they lie in, ascending, (t,)."""
        rank = np.arange(len(polygon)) - np.searchsorted(polygon, polygon)
        numbers: Indices = self.first_triangles[polygon] + rank
        return numbers


class Parts:
    """Finds the parts of a cut mesh."""

    def __init__(self, mesh: LargeMesh, cut: Cut, halo: int, allocate: Allocate = in_memory) -> None:
        """Index the faces around each vertex, in arrays that `allocate` makes; `halo` is the number of steps."""
        self._mesh, self._cut, self._halo = mesh, cut, halo
        self._first_triangles = mesh.triangle_offsets()
        self._offsets, self._faces = _faces_around(mesh, allocate)
        self._seen = np.zeros(len(mesh.positions), dtype=bool)
        self._held = np.zeros(mesh.face_count, dtype=bool)
        self._place = np.zeros(len(mesh.positions), dtype=np.int32)

    def part(self, number: int) -> Part:
        """Return a block with its halo."""
        front = self._cut.order[self._cut.offsets[number] : self._cut.offsets[number + 1]]
        self._seen[front] = True
        vertices, faces = [front], [front[:0]]
        for _ in range(self._halo):
            ahead = [front[:0]]
            for start in range(0, len(front), FRONT_AT_ONCE):
                reached, beside = self._beyond(front[start : start + FRONT_AT_ONCE])
                faces.append(reached)
                ahead.append(beside)
            front = np.concatenate(ahead)
            vertices.append(front)
        own, held = (np.sort(np.concatenate(found)).astype(np.int64) for found in (vertices, faces))
        self._seen[own] = False
        self._held[held] = False
        first = held if self._first_triangles is None else self._first_triangles[held]
        self._place[own] = np.arange(len(own), dtype=np.int32)
        corners, offsets = self._mesh.corners_of(held)
        return Part(own, held, first, self._place[corners], self._mesh.size or np.diff(offsets).astype(np.int32))

    def _beyond(self, front: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Faces around some vertices that were not reached before, and vertices of these that were not seen."""
        reached = np.unique(self._faces[row_positions(self._offsets, front)[0]])
        reached = reached[~self._held[reached]]
        self._held[reached] = True
        corners = self._mesh.corners_of(reached)[0]
        beside = np.unique(corners[~self._seen[corners]]).astype(front.dtype)
        self._seen[beside] = True
        return reached, beside

    def task(self, number: int, part: Part, settings: Settings, reach: int, hurry: bool = False) -> BlockTask:
        """Return the task of solving a block, as early as can be if there is a hurry."""
        mesh, sharp = self._mesh, self._mesh.sharp_edges
        if len(sharp):
            held = np.zeros(len(mesh.positions), dtype=bool)
            held[part.vertices] = True
            self._place[part.vertices] = np.arange(len(part.vertices), dtype=np.int32)
            sharp = self._place[sharp[held[sharp].all(axis=1)]].astype(np.int64)
        return BlockTask(
            number,
            len(self._cut) == 1,
            np.asarray(mesh.positions[part.vertices]),
            self._cut.block[part.vertices],
            part.corners,
            part.sizes,
            None if mesh.weights is None else mesh.weights[part.vertices],
            sharp,
            settings,
            reach,
            hurry,
        )


def _faces_around(mesh: LargeMesh, allocate: Allocate) -> tuple[NDArray[Any], NDArray[Any]]:
    """The faces around each vertex as a ragged array: offsets (V + 1,), and faces, ascending, (C,).

    Faces are sorted by their corners a run at a time, so that no more than a run is held in memory.
    """
    counts = np.zeros(len(mesh.positions), dtype=narrow_type(mesh.corners.size))
    for _, low, run in _runs(mesh):
        counts[low : low + run.shape[1]] += np.diff(run.indptr)
    offsets = allocate("offsets", (len(counts) + 1,), counts.dtype)
    np.cumsum(counts, out=offsets[1:], dtype=counts.dtype)
    faces = allocate("faces", (mesh.corners.size,), narrow_type(mesh.face_count))
    counts[:] = 0
    for first, low, run in _runs(mesh):
        here = slice(low, low + run.shape[1])
        sizes = np.diff(run.indptr)
        places = np.arange(run.nnz) + np.repeat(offsets[here] + counts[here] - run.indptr[:-1], sizes)
        faces[places] = first + run.indices
        counts[here] += sizes
    return offsets, faces


def _runs(mesh: LargeMesh) -> Iterator[tuple[int, int, Any]]:
    """Runs of faces: the first of each, the smallest vertex, and which faces have which vertices from that on."""
    for first in range(0, mesh.face_count, ROWS_AT_ONCE):
        numbers = np.arange(first, min(first + ROWS_AT_ONCE, mesh.face_count))
        corners, offsets = mesh.corners_of(numbers)
        low, high = int(corners.min()), int(corners.max())
        rows = (np.ones(len(corners), np.int8), corners - low, offsets)
        yield first, low, csr_array(rows, shape=(len(numbers), high - low + 1)).tocsc()

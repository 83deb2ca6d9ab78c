"""Where a mesh is cut into blocks, and what each block is given to work on.

The vertices are halved along the longest side of their box until blocks have the wanted size; ties go by the order
along earlier cuts.  That depends on nothing but the positions and the size.  A block is solved with a *halo*: all
vertices up to some number of steps away, a step leading from a vertex to those that share a face with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ..arrays import Indices, row_positions
from ..settings import Settings
from .large_mesh import LargeMesh
from .task import BlockTask


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

    order: Indices
    offsets: Indices
    block: NDArray[np.int32]

    @classmethod
    def of(cls, mesh: LargeMesh, size: int) -> Cut:
        """Cut a mesh into blocks of at most `size` vertices, as equal as can be."""
        positions, count = mesh.positions, -(-len(mesh.positions) // size)
        order = np.arange(len(positions))
        offsets, ahead = np.zeros(count + 1, dtype=np.int64), [(0, len(positions), 0, count)]
        while ahead:
            start, end, first, blocks = ahead.pop()
            if blocks == 1:
                offsets[first + 1] = end
                continue
            own = order[start:end]
            sides = [np.ptp(positions[own, axis]) for axis in range(3)]
            along = positions[own, int(np.argmax(sides))]
            order[start:end] = own[np.argsort(along, kind="stable")]
            left = blocks // 2
            middle = start + (end - start) * left // blocks
            ahead += [(start, middle, first, left), (middle, end, first + left, blocks - left)]
        block = np.empty(len(positions), dtype=np.int32)
        block[order] = np.repeat(np.arange(count, dtype=np.int32), np.diff(offsets))
        return cls(order, offsets, block)

    def __len__(self) -> int:
        return len(self.offsets) - 1


@dataclass(frozen=True, eq=False)
class Part:
    """A block with its halo: n vertices and f faces.

    Attributes
    ----------
    vertices, faces
        Their numbers in the mesh, ascending, (n,) and (f,).
    first_triangles
        Number of each face's first triangle, (f,).
    """

    vertices: Indices
    faces: Indices
    first_triangles: Indices

    def triangle_numbers(self, polygon: Indices) -> Indices:
        """Return the numbers of triangles in the mesh from the faces of the part that they lie in, ascending, (t,)."""
        rank = np.arange(len(polygon)) - np.searchsorted(polygon, polygon)
        numbers: Indices = self.first_triangles[polygon] + rank
        return numbers


class Parts:
    """Finds the parts of a cut mesh."""

    def __init__(self, mesh: LargeMesh, cut: Cut, halo: int) -> None:
        """Index the faces around each vertex; `halo` is the number of steps."""
        self._mesh, self._cut, self._halo = mesh, cut, halo
        self._first_triangles = mesh.triangle_offsets()
        offsets = mesh.offsets
        if offsets is None:
            offsets = np.arange(0, len(mesh.corners) + 1, mesh.size)
        narrow = np.int32 if len(mesh.corners) < 2**31 else np.int64
        rows = (np.ones(len(mesh.corners), np.int8), mesh.corners.astype(narrow, copy=False), offsets.astype(narrow))
        around = csr_array(rows, shape=(mesh.face_count, len(mesh.positions))).tocsc()
        self._offsets, self._faces = around.indptr, around.indices
        self._seen = np.zeros(len(mesh.positions), dtype=bool)
        self._place = np.zeros(len(mesh.positions), dtype=np.int32)

    def part(self, number: int) -> Part:
        """Return a block with its halo."""
        front = self._cut.order[self._cut.offsets[number] : self._cut.offsets[number + 1]]
        self._seen[front] = True
        vertices, faces = [front], []
        for _ in range(self._halo):
            reached = np.unique(self._faces[row_positions(self._offsets, front)[0]])
            faces.append(reached)
            corners = self._mesh.corners_of(reached)[0]
            front = np.unique(corners[~self._seen[corners]])
            self._seen[front] = True
            vertices.append(front)
        own = np.sort(np.concatenate(vertices))
        self._seen[own] = False
        held = np.unique(np.concatenate(faces)).astype(np.int64)
        first = held if self._first_triangles is None else self._first_triangles[held]
        return Part(own, held, first)

    def task(self, number: int, part: Part, settings: Settings, reach: int) -> BlockTask:
        """Return the task of solving a block."""
        mesh, place = self._mesh, self._place
        place[part.vertices] = np.arange(len(part.vertices), dtype=np.int32)
        corners, offsets = mesh.corners_of(part.faces)
        sharp = mesh.sharp_edges
        if len(sharp):
            held = np.zeros(len(mesh.positions), dtype=bool)
            held[part.vertices] = True
            sharp = place[sharp[held[sharp].all(axis=1)]].astype(np.int64)
        return BlockTask(
            number,
            len(self._cut) == 1,
            np.asarray(mesh.positions[part.vertices]),
            self._cut.block[part.vertices],
            place[corners],
            mesh.size or np.diff(offsets).astype(np.int32),
            None if mesh.weights is None else mesh.weights[part.vertices],
            sharp,
            settings,
            reach,
        )

"""Which blocks count in which triangles of the mesh: what is to be read to evaluate the surface at some place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Indices
from .folder import JobFolder
from .large_mesh import narrow_type
from .scratch import Allocate

FIRST, FURTHER = "triangle_blocks.npy", "shared_triangles.npy"


@dataclass(frozen=True, eq=False)
class TriangleIndex:
    """The blocks of T triangles.

    Attributes
    ----------
    first
        The first block that counts in each triangle, -1 where none does, (T,).
    further
        Triangles in which others count too, and these blocks, ascending, (n, 2).
    """

    first: NDArray[np.int32]
    further: NDArray[np.integer[Any]]

    @classmethod
    def load(cls, folder: JobFolder) -> TriangleIndex:
        """Map the index of a finished job into memory."""
        return cls(folder.load(FIRST), folder.load(FURTHER))

    def blocks_of(self, triangles: Indices) -> Indices:
        """Return the blocks that count in some of these triangles, ascending."""
        asked = np.unique(triangles)
        first = self.first[asked]
        row = np.searchsorted(asked, self.further[:, 0])
        there = asked[np.minimum(row, len(asked) - 1)] == self.further[:, 0] if len(asked) else row < 0
        found: Indices = np.unique(np.concatenate([first[first >= 0], self.further[there, 1]])).astype(np.int64)
        return found


class IndexMaker:
    """Makes the index from the blocks, in their order."""

    def __init__(self, triangles: int, allocate: Allocate) -> None:
        self._first = allocate("first", (triangles,), np.int32)  # one more than the block; 0: none so far
        self._further: list[NDArray[Any]] = []

    def add(self, number: int, triangles: Indices) -> None:
        """Note that a block counts in some triangles."""
        taken = self._first[triangles] > 0
        self._first[triangles[~taken]] = number + 1
        rows = np.stack([triangles[taken], np.full(int(taken.sum()), number)], axis=1)
        self._further.append(rows.astype(narrow_type(len(self._first))))

    def save(self, folder: JobFolder) -> None:
        """Write the index into the folder of the job."""
        self._first -= 1
        further = np.concatenate(self._further)
        folder.save(FIRST, self._first)
        folder.save(FURTHER, further[np.lexsort(further.T[::-1])])

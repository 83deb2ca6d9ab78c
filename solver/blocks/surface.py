"""The surface of a mesh in blocks, evaluated without loading it as a whole."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, Indices
from ..errors import InputError
from ..progress import run_to_end
from ..surface.flat import checked_places
from .content import SolvedBlock
from .folder import JobFolder
from .resampled import BlocksResampled, resample_blocks_steps
from .triangle_index import TriangleIndex

BLOCKS_AT_ONCE = 4
"""Blocks that stay in memory."""


class BlockSurface:
    """The blended surface of B blocks: S(x) = sum_b W_b(x) S_b(x).

    S_b is the surface of block b by itself, over the block and its halo, and W_b its share (see `shares`).  Because the
    shares are positive and one in sum, no error is larger than the largest of the blocks.

    Attributes
    ----------
    folder
        The job's folder, which holds the surface; it is read when it is needed.
    blocks, triangles, corners
        How many the mesh has; corners of faces.
    index
        Which blocks are to be read for which triangles.
    """

    def __init__(self, folder: JobFolder, keeper: object = None) -> None:
        """Open a finished job; `keeper` is what keeps its folder alive."""
        self.folder, self._keeper = folder, keeper
        self.blocks: int = folder.job["blocks"]
        counts = folder.report["input"]
        self.triangles: int = counts["triangles"]
        self.corners: int = counts["triangles"] + 2 * counts["faces"]
        self.index = TriangleIndex.load(folder)
        self._held: dict[int, tuple[SolvedBlock, Indices]] = {}

    @classmethod
    def load(cls, folder: Path | str) -> BlockSurface:
        """Open the folder of a finished job.

        Raises
        ------
        FileFormatError
            When it holds none.
        """
        return cls(JobFolder(Path(folder)))

    def save(self, folder: Path | str) -> None:
        """Copy the job's folder to a new place.

        Raises
        ------
        InputError
            When something is there already.
        """
        goal = Path(folder)
        if goal.exists():
            raise InputError(f"'{goal}' is there already.")
        draft = goal.with_name(f".{goal.name}_draft")
        shutil.rmtree(draft, ignore_errors=True)
        try:
            shutil.copytree(self.folder.path, draft)
            draft.replace(goal)
        finally:
            shutil.rmtree(draft, ignore_errors=True)

    def at_vertices(self) -> NDArray[np.floating[Any]]:
        """The surface at the input's vertices, (V, 3), of the input's type, mapped into memory."""
        return self.folder.load("vertices.npy")

    def evaluate(self, face_index: ArrayLike, barycentric: ArrayLike) -> Array:
        """Evaluate the surface at points of the mesh.

        Parameters
        ----------
        face_index
            Triangles, (N,); where all input faces are triangles these are its faces.
        barycentric
            Barycentric coordinates in these triangles, (N, 3).

        Returns
        -------
        ndarray
            Points of the surface in scene units, (N, 3).

        Raises
        ------
        InputError
            When a triangle does not exist or the arrays do not fit.
        """
        face, inside = checked_places(face_index, barycentric, self.triangles)
        points = np.zeros((len(face), 3))
        for number in map(int, self.index.blocks_of(face)):
            solved, numbers = self.block(number)
            place = np.minimum(np.searchsorted(numbers, face), max(len(numbers) - 1, 0))
            here = np.flatnonzero(numbers[place] == face) if len(numbers) else np.zeros(0, dtype=np.int64)
            shares = solved.share[solved.surface.triangles[place[here]]]
            share = (shares * inside[here]).sum(axis=1)
            share[(shares == 1.0).all(axis=1)] = 1.0
            here, share = here[share > 0.0], share[share > 0.0]
            if len(here):
                points[here] += share[:, None] * solved.surface.evaluate(place[here], inside[here])
        return points

    def resample(self, splits: int, beside: Path | None = None) -> BlocksResampled:
        """Evaluate the surface on its mesh with every edge split into N parts, without loading either.

        Parameters
        ----------
        splits
            N, the number of parts of every edge.  With 1 the input's faces stay as they are.
        beside
            Folder in which a temporary one holds the mesh; where None, the system's for such.

        Returns
        -------
        BlocksResampled
            `vertices` (P, 3), those of the input first, `corners` (L,), `sizes` (F,) and `faces`, in the order of the
            blocks, mapped into memory.

        Raises
        ------
        InputError
            When `splits` is not positive, or the mesh would have more corners than 32 bits can count.
        """
        return run_to_end(resample_blocks_steps(self, splits, beside))

    def block(self, number: int) -> tuple[SolvedBlock, Indices]:
        """Return a solved block, and the numbers of its triangles in the mesh."""
        if number not in self._held:
            solved, part = self.folder.block(number), self.folder.part(number)
            while len(self._held) >= BLOCKS_AT_ONCE:
                del self._held[next(iter(self._held))]
            self._held[number] = solved, part.triangle_numbers(solved.surface.polygon)
        return self._held[number]

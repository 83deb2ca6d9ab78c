"""The surface of a mesh in blocks, evaluated without loading it as a whole."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, Indices
from ..errors import InputError
from ..surface.flat import checked_places
from .content import SolvedBlock
from .folder import JobFolder

BLOCKS_AT_ONCE = 2
"""Blocks that stay in memory."""


class BlockSurface:
    """The blended surface of B blocks: S(x) = sum_b W_b(x) S_b(x).

    S_b is the surface of block b by itself, over the block and its halo, and W_b its share (see `shares`).  Because the
    shares are positive and one in sum, no error is larger than the largest of the blocks.

    Attributes
    ----------
    folder
        The job's folder, which holds the surface; it is read when it is needed.
    """

    def __init__(self, folder: JobFolder, keeper: object = None) -> None:
        """Open a finished job; `keeper` is what keeps its folder alive."""
        self.folder, self._keeper = folder, keeper
        self.blocks: int = folder.job["blocks"]
        self.triangles: int = folder.report["input"]["triangles"]
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
        for number in range(self.blocks):
            solved, numbers = self._read(number)
            place = np.minimum(np.searchsorted(numbers, face), max(len(numbers) - 1, 0))
            here = np.flatnonzero(numbers[place] == face) if len(numbers) else np.zeros(0, dtype=np.int64)
            shares = solved.share[solved.surface.triangles[place[here]]]
            share = (shares * inside[here]).sum(axis=1)
            share[(shares == 1.0).all(axis=1)] = 1.0
            here, share = here[share > 0.0], share[share > 0.0]
            if len(here):
                points[here] += share[:, None] * solved.surface.evaluate(place[here], inside[here])
        return points

    def _read(self, number: int) -> tuple[SolvedBlock, Indices]:
        """Return a block, and the numbers of its triangles in the mesh."""
        if number not in self._held:
            solved, part = self.folder.block(number), self.folder.part(number)
            while len(self._held) >= BLOCKS_AT_ONCE:
                del self._held[next(iter(self._held))]
            self._held[number] = solved, part.triangle_numbers(solved.surface.polygon)
        return self._held[number]

"""A job's folder: what is done, a file for each block, and at the end the result.

Every file appears when it is complete, so a job that was killed goes on from what is there.

    job.json          what the job is: a fingerprint of the mesh, the settings, the size of the blocks
    blocks/00000.npz  a solved block (see `content`); its presence says that the block is done
    blocks/00000.hurried.npz  one that was ended early; the next run solves the block again
    noise.json        the noise level that all blocks remove, where it had to be estimated
    parts/00000.npy   the block's part: how many vertices and faces it has, their numbers, and the faces' corners
    scratch           arrays of a job that runs (see `scratch`)
    triangle_blocks.npy, shared_triangles.npy   which blocks count in which triangles (see `triangle_index`)
    vertices.npy, error.npy, patch.npy, creases.npy, report.json
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..atomic_files import atomic_output
from ..errors import FileFormatError, InputError
from .content import MeasuredBlock, SolvedBlock, sizes_in
from .cut import Part
from .large_mesh import narrow_type

JOB, REPORT, CREASES = "job.json", "report.json", "creases.npy"

PART_COLUMNS = 5
"""Arrays of a part in one file."""


@dataclass(frozen=True)
class JobFolder:
    """The folder of one job."""

    path: Path

    @classmethod
    def of(cls, path: Path, job: dict[str, Any]) -> JobFolder:
        """Begin a job in a folder, or go on with the one that it holds.

        Raises
        ------
        InputError
            When the folder holds another job, or something else.
        """
        folder = cls(path)
        if (path / JOB).is_file():
            for name, value in folder.job.items():
                if job.get(name) != value:
                    raise InputError(f"'{path}' holds a job with other {name}; name another folder.")
            return folder
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise InputError(f"'{path}' holds something else than a job; name a new or empty folder.")
        for part in ("blocks", "parts"):
            (path / part).mkdir(parents=True, exist_ok=True)
        folder.write_json(JOB, job)
        return folder

    @property
    def job(self) -> dict[str, Any]:
        """What the job is.

        Raises
        ------
        FileFormatError
            When the folder holds no job, or its file is damaged.
        """
        return self.read_json(JOB)

    @property
    def report(self) -> dict[str, Any]:
        """The report of the finished job; raises as `job` does."""
        return self.read_json(REPORT)

    @property
    def scratch(self) -> Path:
        """Where a job that runs has its large arrays."""
        return self.path / "scratch"

    def is_there(self, name: str) -> bool:
        """Whether the folder has a file of this name."""
        return (self.path / name).is_file()

    def is_done(self, number: int) -> bool:
        """Whether a block is there, and no hurried one."""
        return self._done(number).is_file()

    def keep(self, number: int, content: bytes, hurried: bool) -> None:
        """Keep a solved block; a hurried one stands in for the block only in this run."""
        with atomic_output(self._hurried(number) if hurried else self._done(number)) as draft:
            draft.write_bytes(content)

    def reopen(self) -> None:
        """Forget the report of a run that was ended early, and the blocks that it hurried."""
        (self.path / REPORT).unlink(missing_ok=True)
        for path in (self.path / "blocks").glob("*.hurried.npz"):
            path.unlink()

    def block(self, number: int) -> SolvedBlock:
        """Read a solved block.

        Raises
        ------
        FileFormatError
            When its file is damaged; without the file the job does the block again.
        """
        path = self._block(number)
        with open(path, "rb") as file:
            return SolvedBlock.read(file, f"'{path}'")

    def measured(self, number: int) -> MeasuredBlock:
        """Read what is measured of a solved block, without its surface; raises as `block` does."""
        path = self._block(number)
        with open(path, "rb") as file:
            return MeasuredBlock.read(file, f"'{path}'")

    def blended(self, number: int) -> int:
        """How many triangles a solved block shares with others; raises as `block` does."""
        path = self._block(number)
        with open(path, "rb") as file:
            return sizes_in(file, f"'{path}'")["blended"]

    def keep_part(self, number: int, part: Part) -> None:
        """Keep which vertices and faces a block's part has."""
        first = part.first_triangles if part.first_triangles is not part.faces else part.faces[:0]
        size, sizes = (part.sizes, part.faces[:0]) if isinstance(part.sizes, int) else (0, part.sizes)
        columns = [part.vertices, part.faces, first, sizes, part.corners]
        largest = max(int(column.max(initial=0)) for column in columns)
        counts = [*map(len, columns), size]
        numbers = np.concatenate([counts, *columns], dtype=narrow_type(largest), casting="unsafe")
        self.save(f"parts/{number:05}.npy", numbers)

    def part(self, number: int) -> Part:
        """Vertices and faces of a block's part."""
        numbers = np.asarray(self.load(f"parts/{number:05}.npy"))
        *counts, size = map(int, numbers[: PART_COLUMNS + 1])
        columns = np.split(numbers[PART_COLUMNS + 1 :], np.cumsum(counts)[:-1])
        vertices, faces, first = (column.astype(np.int64) for column in columns[:3])
        sizes, corners = (column.astype(np.int32, copy=False) for column in columns[3:])
        return Part(vertices, faces, first if len(first) else faces, corners, size or sizes)

    def save(self, name: str, array: NDArray[Any]) -> None:
        """Write an array."""
        with atomic_output(self.path / name) as draft, open(draft, "wb") as file:
            np.save(file, array, allow_pickle=False)

    def load(self, name: str) -> NDArray[Any]:
        """Map an array into memory."""
        array: NDArray[Any] = np.load(self.path / name, mmap_mode="r", allow_pickle=False)
        return array

    def write_json(self, name: str, values: dict[str, Any]) -> None:
        """Write plain values."""
        with atomic_output(self.path / name) as draft:
            draft.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")

    def read_json(self, name: str) -> dict[str, Any]:
        """Read plain values; raises `FileFormatError` where they are not there or damaged."""
        try:
            values: dict[str, Any] = json.loads((self.path / name).read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise FileFormatError(f"'{self.path}' lacks {name}: it holds no finished job.") from None
        except ValueError:
            raise FileFormatError(f"'{self.path / name}' is damaged.") from None
        return values

    def _done(self, number: int) -> Path:
        return self.path / "blocks" / f"{number:05}.npz"

    def _hurried(self, number: int) -> Path:
        return self.path / "blocks" / f"{number:05}.hurried.npz"

    def _block(self, number: int) -> Path:
        return self._done(number) if self.is_done(number) else self._hurried(number)

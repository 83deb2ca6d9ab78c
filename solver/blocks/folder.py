"""A job's folder: what is done, a file for each block, and at the end the result.

Every file appears when it is complete, so a job that was killed goes on from what is there.

    job.json          what the job is: a fingerprint of the mesh, the settings, the size of the blocks
    blocks/00000.npz  a solved block (see `content`); its presence says that the block is done
    noise.json        the noise level that all blocks remove, where it had to be estimated
    parts/00000.npy   vertices and faces of the block's part: how many, then their numbers
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
from .content import SolvedBlock
from .cut import Part

JOB, REPORT, CREASES = "job.json", "report.json", "creases.npy"


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

    def is_there(self, name: str) -> bool:
        """Whether the folder has a file of this name."""
        return (self.path / name).is_file()

    def is_done(self, number: int) -> bool:
        """Whether a block is there."""
        return self._block(number).is_file()

    def keep(self, number: int, content: bytes) -> None:
        """Keep a solved block."""
        with atomic_output(self._block(number)) as draft:
            draft.write_bytes(content)

    def block(self, number: int) -> SolvedBlock:
        """Read a solved block.

        Raises
        ------
        FileFormatError
            When its file is damaged; without the file the job does the block again.
        """
        path = self._block(number)
        return SolvedBlock.from_bytes(path.read_bytes(), f"'{path}'")

    def keep_part(self, number: int, part: Part) -> None:
        """Keep which vertices and faces a block's part has."""
        columns = [part.vertices, part.faces]
        if part.first_triangles is not part.faces:
            columns.append(part.first_triangles)
        numbers = np.concatenate([[len(part.vertices), len(part.faces)], *columns])
        narrow = np.int32 if numbers.max() <= np.iinfo(np.int32).max else np.int64
        self.save(f"parts/{number:05}.npy", numbers.astype(narrow))

    def part(self, number: int) -> Part:
        """Vertices and faces of a block's part."""
        numbers = self.load(f"parts/{number:05}.npy").astype(np.int64)
        vertices, faces = map(int, numbers[:2])
        columns = np.split(numbers[2:], [vertices, vertices + faces])
        return Part(columns[0], columns[1], columns[2] if len(columns[2]) else columns[1])

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

    def _block(self, number: int) -> Path:
        return self.path / "blocks" / f"{number:05}.npz"

"""Large arrays of a job that runs, in files: the system keeps of them in memory what there is room for."""

from __future__ import annotations

import math
import mmap
import shutil
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

Allocate = Callable[[str, tuple[int, ...], Any], NDArray[Any]]
"""Makes an array of zeros by name, shape and type, in memory or in a file."""


def in_memory(name: str, shape: tuple[int, ...], kind: Any) -> NDArray[Any]:
    """Allocate an array in memory."""
    return np.zeros(shape, kind)


class Scratch:
    """Arrays in a folder that vanishes when the context ends; what a killed process left there goes before.

    Parameters
    ----------
    folder
        Where; it need not be there.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._maps: list[mmap.mmap] = []

    def __enter__(self) -> Self:
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.mkdir(exist_ok=True)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._maps.clear()
        shutil.rmtree(self._folder, ignore_errors=True)

    def array(self, name: str, shape: tuple[int, ...], kind: Any) -> NDArray[Any]:
        """Make an array of zeros."""
        size = math.prod(shape) * np.dtype(kind).itemsize
        if not size:
            return np.zeros(shape, kind)
        with open(self._folder / name, "w+b") as file:
            file.truncate(size)
            self._maps.append(mmap.mmap(file.fileno(), size))
        return np.frombuffer(self._maps[-1], kind).reshape(shape)

    def rest(self) -> None:
        """Count nothing of the arrays as this process's memory until they are used again."""
        if hasattr(mmap, "MADV_DONTNEED"):  # not on Windows, which does the same where memory gets short
            for each in self._maps:
                each.madvise(mmap.MADV_DONTNEED)

"""Ragged arrays: rows of different lengths one after the other, and the offsets at which they start."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]


def offsets_of(sizes: NDArray[np.int64]) -> Integers:
    """Return where rows of the given sizes, (K,), start and end: (K + 1,), from 0."""
    offsets = np.zeros(len(sizes) + 1, dtype=np.int64)
    np.cumsum(sizes, out=offsets[1:])
    return offsets


def row_positions(offsets: Integers, rows: NDArray[np.int64]) -> tuple[Integers, Integers]:
    """Return the positions that the chosen rows occupy, in their order, and the offsets of those rows by themselves."""
    sizes = offsets[rows + 1] - offsets[rows]
    new = offsets_of(sizes)
    positions = np.arange(new[-1], dtype=np.int64)
    positions += np.repeat(offsets[rows] - new[:-1], sizes)
    return positions, new

"""The types of arrays, and ragged arrays: rows of different lengths in one array, with the offsets where they start."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Booleans = NDArray[np.bool_]


def has_masked(values: object) -> bool:
    """Whether an array has masked values, which NumPy's functions would take for values like others."""
    return isinstance(values, np.ma.MaskedArray) and bool(np.any(values.mask))


def offsets_of(sizes: Indices) -> Indices:
    """Return where rows of the given sizes, (K,), start and end: (K + 1,), from 0."""
    offsets = np.zeros(len(sizes) + 1, dtype=np.int64)
    np.cumsum(sizes, out=offsets[1:])
    return offsets


def row_positions(offsets: Indices, rows: Indices) -> tuple[Indices, Indices]:
    """Return the positions that the chosen rows occupy, in their order, and the offsets of those rows by themselves."""
    sizes = offsets[rows + 1] - offsets[rows]
    new = offsets_of(sizes)
    positions = np.arange(new[-1], dtype=np.int64)
    positions += np.repeat(offsets[rows] - new[:-1], sizes)
    return positions, new


def runs_of_rows(offsets: Indices, most: int) -> Iterator[tuple[int, int]]:
    """Split the rows into runs, first and one past the last, that each have about `most` entries together."""
    block = offsets[:-1] // most
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    for first, end in zip(starts, np.append(starts, len(block))[1:], strict=True):
        yield int(first), int(end)


def rows_in_order(rows: Indices, names: Indices, wanted: Indices) -> Indices:
    """Return each row, (S, 3), permuted in such a way that the `names` of its entries come in the `wanted` order."""
    place = (names[:, None, :] == wanted[:, :, None]).argmax(axis=2)
    return np.take_along_axis(rows, place, axis=1)

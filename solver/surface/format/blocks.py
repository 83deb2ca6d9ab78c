"""Blocks: arrays of numbers as one run of compressed bytes, with a table of their sizes.

A block is an array of whole numbers of any size, or of real numbers to the last bit.  Its bytes are sorted into planes,
lowest bytes first, which LZMA's range coder then compresses.
"""

from __future__ import annotations

import json
import lzma
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from ..container import demand

MOST_PLANES = 6
"""Bytes of the largest whole number: 47 bits and a sign."""

LARGEST_TABLE = 20_000
REALS = {"f4": 4, "f8": 8}
RAW = {"u1", "u2"}

Coding = tuple[int, int, int]
LITERALS: tuple[Coding, ...] = ((0, 0, 0), (3, 0, 0), (0, 2, 2))
"""What the literals' contexts may be: nothing, the byte before, or the place modulo four; the smallest is taken."""


CHUNK = 1 << 16
"""Most bytes of a chunk of LZMA2 that holds them as they are."""


def _filters(coding: Coding, size: int) -> list[dict[str, int]]:
    lc, lp, pb = coding
    dictionary = min(max(size, 4096), 1 << 24)  # known from the size, so that no file can ask for more
    return [{"id": lzma.FILTER_LZMA2, "preset": 6, "dict_size": dictionary, "lc": lc, "lp": lp, "pb": pb}]


def _planes(numbers: Indices) -> NDArray[np.uint8]:
    """Bytes of whole numbers, (planes, n): 0, -1, 1, -2 ... are 0, 1, 2, 3 ..."""
    folded = np.ascontiguousarray((numbers << 1) ^ (numbers >> 63)).astype("<u8")
    planes = max((int(folded.max(initial=0)).bit_length() + 7) // 8, 1)
    return folded.view(np.uint8).reshape(-1, 8).T[:planes]


def _numbers(planes: NDArray[np.uint8]) -> Indices:
    wide = np.zeros((planes.shape[1], 8), dtype=np.uint8)
    wide[:, : len(planes)] = planes.T
    folded = wide.view("<u8").ravel()
    return (folded >> np.uint64(1)).astype(np.int64) ^ -(folded & np.uint64(1)).astype(np.int64)


def _as_it_is(content: bytes) -> bytes:
    """Return a stream of LZMA2 that holds bytes in chunks that are not compressed; the first resets the dictionary."""
    parts = []
    for start in range(0, len(content), CHUNK):
        piece = content[start : start + CHUNK]
        parts += [b"\x02" if start else b"\x01", (len(piece) - 1).to_bytes(2, "big"), piece]
    return b"".join([*parts, b"\x00"])


class BlockWriter:
    """Collects blocks under names.

    Parameters
    ----------
    quick
        Whether to leave the bytes as they are, in the same format: takes no time.
    """

    def __init__(self, quick: bool = False) -> None:
        self._quick = quick
        self._table: dict[str, list[Any]] = {}
        self._parts: list[bytes] = []

    def whole(self, name: str, numbers: NDArray[Any]) -> None:
        """Add an array of whole numbers below 2^47."""
        planes = _planes(np.asarray(numbers, dtype=np.int64).ravel())
        if len(planes) > MOST_PLANES:
            raise OverflowError(f"{name} needs numbers of more than 47 bits")
        self._add(name, len(planes), planes)

    def real(self, name: str, numbers: Array) -> None:
        """Add an array of real numbers, in single precision where that holds the same."""
        values = np.asarray(numbers, dtype="<f8").ravel()
        with np.errstate(over="ignore", invalid="ignore"):
            single = values.astype("<f4")
        if np.array_equal(single.astype("<f8"), values, equal_nan=True):
            values = single
        self._add(name, values.dtype.str[1:], values.view(np.uint8).reshape(-1, values.itemsize).T)

    def raw(self, name: str, values: NDArray[Any]) -> None:
        """Add bytes or 16-bit words that nothing makes smaller."""
        self._table[name] = [values.dtype.str[1:], len(values), -1, values.nbytes]
        self._parts.append(values.tobytes())

    def take(self, other: BlockWriter) -> None:
        """Add the blocks of another writer."""
        self._table |= other._table
        self._parts += other._parts

    def _add(self, name: str, kind: int | str, planes: NDArray[np.uint8]) -> None:
        content = np.ascontiguousarray(planes).tobytes()
        if self._quick:
            packed = [_as_it_is(content)]
        else:
            packed = [lzma.compress(content, lzma.FORMAT_RAW, filters=_filters(c, len(content))) for c in LITERALS]
        best = min(range(len(packed)), key=lambda k: len(packed[k]))
        self._table[name] = [kind, planes.shape[1], best, len(packed[best])]
        self._parts.append(packed[best])

    @property
    def size(self) -> int:
        """Bytes of the blocks."""
        return sum(len(part) for part in self._parts)

    def content(self) -> bytes:
        """Table and blocks, behind the length of the table."""
        table = lzma.compress(json.dumps(self._table, separators=(",", ":")).encode("ascii"), lzma.FORMAT_ALONE)
        return b"".join([len(table).to_bytes(4, "little"), table, *self._parts])


class BlockReader:
    """Finds blocks by their names, and refuses those that are not as long as expected.

    Parameters
    ----------
    content
        What `BlockWriter.content` returned.
    """

    def __init__(self, content: bytes) -> None:
        start = 4 + int.from_bytes(content[:4], "little")
        demand(4 < start <= len(content) and start <= LARGEST_TABLE, "its table is cut")
        text = lzma.LZMADecompressor(lzma.FORMAT_ALONE, memlimit=1 << 24).decompress(content[4:start], LARGEST_TABLE)
        self._content, self._places = content, dict[str, tuple[int | str, int, int, int, int]]()
        table = json.loads(text.decode("ascii"))
        demand(isinstance(table, dict), "its table is damaged")
        for name, entry in table.items():
            demand(_is_entry(entry), f"the block {name[:40]!r} is damaged")
            kind, count, coding, size = entry
            self._places[name] = (kind, count, coding, start, start + size)
            start += size
        demand(start == len(content), "a block is cut")

    def __contains__(self, name: str) -> bool:
        return name in self._places

    def whole(self, name: str, *shape: int) -> Indices:
        """Return an array of whole numbers."""
        kind, planes = self._planes(name, shape)
        demand(isinstance(kind, int), f"{name} is not made of whole numbers")
        return _numbers(planes).reshape(shape)

    def real(self, name: str, *shape: int) -> Array:
        """Return an array of real numbers."""
        kind, planes = self._planes(name, shape)
        demand(isinstance(kind, str), f"{name} is not made of real numbers")
        values = np.ascontiguousarray(planes.T).view(f"<{kind}").ravel()
        return values.astype(np.float64).reshape(shape)

    def raw(self, name: str, kind: str, most: int) -> NDArray[Any]:
        """Return up to `most` bytes or words that are stored as they are."""
        demand(name in self._places, f"it lacks {name}")
        own, count, coding, start, end = self._places[name]
        good = own == kind[1:] and coding == -1 and count <= most and end - start == count * int(kind[2:])
        demand(good, f"{name} is damaged")
        return np.frombuffer(self._content, dtype=kind, count=count, offset=start)

    def some(self, name: str, most: int) -> Indices:
        """Return up to `most` whole numbers."""
        demand(name in self._places and self._places[name][1] <= most, f"{name} is damaged")
        return self.whole(name, self._places[name][1])

    def listed(self, name: str, most: int, end: int) -> Indices:
        """Return up to `most` ascending whole numbers from 0 to below `end`, stored as their differences."""
        numbers = np.cumsum(self.some(name, most))
        good = not len(numbers) or (numbers[0] >= 0 and (np.diff(numbers) > 0).all() and numbers[-1] < end)
        demand(good, f"{name} names what is not there")
        return numbers

    def _planes(self, name: str, shape: tuple[int, ...]) -> tuple[int | str, NDArray[np.uint8]]:
        demand(name in self._places, f"it lacks {name}")
        kind, count, coding, start, end = self._places[name]
        demand(coding >= 0, f"{name} is damaged")
        expected = int(np.prod(shape, dtype=object)) if shape else 1
        demand(count == expected, f"{name} has {count} numbers where {expected} are expected")
        planes = kind if isinstance(kind, int) else REALS[kind]
        size = planes * count
        decoder = lzma.LZMADecompressor(lzma.FORMAT_RAW, filters=_filters(LITERALS[coding], size))
        data = decoder.decompress(self._content[start:end], size)
        demand(len(data) == size, f"{name} is cut")
        return kind, np.frombuffer(data, dtype=np.uint8).reshape(planes, count)

    @property
    def names(self) -> Mapping[str, Any]:
        """What blocks there are."""
        return self._places


def _is_entry(entry: Any) -> bool:
    if not (isinstance(entry, list) and len(entry) == 4 and all(type(number) is int for number in entry[1:])):
        return False
    kind, count, coding, size = entry
    if coding == -1:
        known = kind in RAW
    else:
        known = kind in REALS if isinstance(kind, str) else type(kind) is int and 1 <= kind <= MOST_PLANES
    return known and 0 <= count < 1 << 40 and -1 <= coding < len(LITERALS) and size >= 0

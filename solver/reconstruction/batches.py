"""A cloud in parts: whatever sizes they are read in, they are worked on in batches of one size."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array
from ..errors import InputError

AT_ONCE = 1 << 18
"""Rows that are worked on together."""

Parts = Iterable[Any]
"""Anything that yields parts of a cloud each time that it is iterated over: arrays (n, 3), or objects that have
`points`, `colours` and `normals` of this shape, the last two or None."""


@dataclass(frozen=True)
class Batch:
    """Rows of a cloud, (n, 3) each; colours and normals are None where a row lacks them."""

    points: Array
    colours: Array | None = None
    normals: Array | None = None

    @classmethod
    def of(cls, part: Any) -> Batch:
        """Take a part as it was given; raises `InputError` where it is not an array of three numbers each."""
        points = getattr(part, "points", None)
        others = (getattr(part, name, None) for name in ("colours", "normals"))
        return cls(
            _three(part if points is None else points), *(None if own is None else _three(own) for own in others)
        )

    def some(self, rows: slice) -> Batch:
        """Return some of the rows."""
        colours, normals = (None if own is None else own[rows] for own in (self.colours, self.normals))
        return Batch(self.points[rows], colours, normals)

    @classmethod
    def joined(cls, parts: list[Batch]) -> Batch:
        """Put parts together."""
        points = np.concatenate([part.points for part in parts])
        return cls(points, _joined([part.colours for part in parts]), _joined([part.normals for part in parts]))


def _joined(columns: list[Array | None]) -> Array | None:
    there = [own for own in columns if own is not None]
    return np.concatenate(there) if len(there) == len(columns) else None


@dataclass(frozen=True)
class ArrayParts:
    """An array (P, 3), which may be mapped into memory, in parts."""

    points: NDArray[Any]

    def __iter__(self) -> Iterator[NDArray[Any]]:
        """Yield some rows at a time."""
        return (self.points[start : start + AT_ONCE] for start in range(0, len(self.points), AT_ONCE))


def as_parts(points: ArrayLike | Parts) -> Parts:
    """Return an array (P, 3) in parts, and a cloud that is in parts as it is.

    Raises
    ------
    InputError
        When it can be read only once, or is no array of three numbers each.
    """
    if isinstance(points, Iterator):
        raise InputError(
            "Points in parts are read several times: give something that can be looped over again, not a generator."
        )
    array_like = hasattr(points, "__array__") or hasattr(points, "__len__")
    if not array_like or (isinstance(points, (list, tuple)) and len(points) and np.ndim(points[0]) != 1):
        return points  # type: ignore[return-value]
    array = points if isinstance(points, np.ndarray) else _three(points)
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"The points must be an array of three numbers each, not of shape {array.shape}.")
    return ArrayParts(array)


def batches(parts: Parts, size: int = AT_ONCE) -> Iterator[Batch]:
    """Yield the rows of a cloud in their order, `size` at a time; raises `InputError` as `Batch.of`."""
    waiting: list[Batch] = []
    count = 0
    for part in map(Batch.of, parts):
        waiting.append(part)
        count += len(part.points)
        while count >= size:
            whole = Batch.joined(waiting)
            yield whole.some(slice(size))
            waiting, count = [whole.some(slice(size, None))], count - size
    if count:
        yield Batch.joined(waiting)


def _three(values: Any) -> Array:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("The points must be an array of three numbers each.") from None
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"The points must be an array of three numbers each, not of shape {array.shape}.")
    return array

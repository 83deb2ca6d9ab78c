"""Values of a file, read and predicted round after round by the compiled kernel: `reading.c`."""

from __future__ import annotations

from ctypes import Structure, addressof, byref, c_double, c_int64, c_void_p
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Booleans, Indices
from .domains import Damping, SparsePatches
from .library import function
from .predicted import Parallelograms, UnfoldedTriangles
from .stored import CUT_SHORT, Links, StoredNumbers

NO_TABLE, TOO_LARGE = 5, 6
REFUSALS = {CUT_SHORT: "{} is cut", NO_TABLE: "{} has a wrong table", TOO_LARGE: "a value of {} is too large"}
"""What is wrong with the numbers of some name, as the end of a sentence, by what the kernel returns."""


class _ReadValues(Structure):
    _fields_ = (
        *((name, c_void_p) for name in ("numbers", "has_table")),
        ("contexts", c_int64),
        ("bound", c_void_p),
        ("largest", c_double),
        *((name, c_void_p) for name in ("value", "size")),
    )


class _Limits(Structure):
    _fields_ = tuple(
        (name, c_double) for name in ("expected", "largest_start", "anywhere", "least_speed", "largest_speed")
    )


class _Domains(Structure):
    _fields_ = tuple(
        (name, c_void_p) for name in ("triangles", "functions", "damping", "limits", "target", "step", "patch", "off")
    )


@dataclass(frozen=True)
class DomainLimits:
    """How domains are found; `surface.format.domains` has the same as constants."""

    expected: float
    largest_start: float
    anywhere: float
    least_speed: float
    largest_speed: float


class StoredValues:
    """Values as numbers of steps from what is predicted.

    Parameters
    ----------
    numbers
        The numbers.
    has_table
        Which of C contexts have a table, (C,).
    bounds
        What is expected, in steps, at most in each context but the last, (C - 1,).
    largest
        Of all values.
    """

    def __init__(self, numbers: StoredNumbers, has_table: Booleans, bounds: Array, largest: float) -> None:
        self._numbers, self._has_table = numbers, np.ascontiguousarray(has_table, dtype=np.uint8)
        self._bounds, self._largest = np.ascontiguousarray(bounds, dtype=np.float64), largest

    def positions(self, links: Parallelograms, known: Booleans, positions: Array, sizes: Array, steps: Array) -> int:
        """Read the positions (V, 3) that links lead to from those that are `known`, (V,).

        Parameters
        ----------
        sizes
            How far positions are from what was predicted, (V, 3).
        steps
            Their steps, (V,).

        Returns
        -------
        0, or one of `REFUSALS`.  Positions and sizes are changed.
        """
        marks, step = _marks(known), np.ascontiguousarray(steps)
        rows, own = Links.of(links.links, np.array([0, len(positions)])), self._structure(positions, sizes)
        return _status(function("read_positions")(byref(rows), byref(own), _address(marks), _address(step)))

    def domains(
        self,
        triangles: UnfoldedTriangles,
        functions: SparsePatches,
        damping: Damping,
        limits: DomainLimits,
        known: Booleans,
        target: Array,
        steps: Array,
        offsets: Indices,
    ) -> tuple[int, Array]:
        """Read domains; rounds grow from the `known` ones, (M,).

        Parameters
        ----------
        target, steps
            Of each patch vertex, (M, r) and (M,).
        offsets
            Where the vertices of each patch begin, (K + 1,).

        Returns
        -------
        0, or one of `REFUSALS`; and the domains, (M, 2).
        """
        count = len(target)
        patch = np.repeat(np.arange(len(offsets) - 1, dtype=np.int32), np.diff(offsets))
        domains, sizes, off = (np.zeros((count, 2)) for _ in range(3))
        parts = [np.ascontiguousarray(part) for part in (target, steps, patch, off)]
        structures = triangles.own, functions.own, damping.structure(), _Limits(*astuple(limits))
        given = _Domains(*(addressof(part) for part in structures), *(part.ctypes.data for part in parts))
        rows, own, marks = Links.of(triangles.links, offsets), self._structure(domains, sizes), _marks(known)
        status = function("read_domains")(byref(rows), byref(own), byref(given), _address(marks))
        return _status(status), domains

    def _structure(self, values: Array, sizes: Array) -> _ReadValues:
        """The same as the kernel takes it, reading to values and sizes (N, d)."""
        arrays = self._has_table, self._bounds, values, sizes
        has_table, bounds, value, size = (part.ctypes.data for part in arrays)
        numbers = addressof(self._numbers.own)
        return _ReadValues(numbers, has_table, len(self._has_table), bounds, self._largest, value, size)


def _status(status: int) -> int:
    if status and status not in REFUSALS:
        raise MemoryError("There is not enough memory to read the file.")
    return status


def _marks(known: Booleans) -> NDArray[np.uint8]:
    return np.array(known, dtype=np.uint8)


def _address(array: NDArray[Any]) -> c_void_p:
    return c_void_p(array.ctypes.data)

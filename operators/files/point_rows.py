"""Rows of point files as they stand there, some at a time, and those of text files.  Needs no Blender.

Coordinates are read in double precision: those of surveys have ten digits.  What colours and normals mean often shows
only when all rows were seen; `Meaning` collects that.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...solver.errors import FileFormatError

Floats = NDArray[np.float64]

ROWS_AT_ONCE = 1 << 17
"""Rows that are read at once, where the file leaves the choice."""

TEXT_TABLES = (".xyz", ".txt", ".csv", ".asc", ".pts")
"""Files of lines that begin with three numbers, separated by blanks, commas or semicolons."""

COMMENT = ("#", "//", "%")
NAMES = {"red": "r", "green": "g", "blue": "b", "//x": "x", "easting": "x", "northing": "y", "elevation": "z"}
NAMES |= {f"normal{joint}{axis}": f"n{axis}" for joint in ("", "_") for axis in "xyz"}
"""What headers call the columns x, y, z, r, g, b, nx, ny, nz otherwise."""

UNIT = 0.02
"""Three columns without names hold normals if their lengths differ from one by less than this in every row."""


@dataclass(frozen=True)
class Rows:
    """Some rows of a file, (n, 3) each: points, and as far as the file has them colours as they are there, and normals.

    Attributes
    ----------
    guessed
        Whether colours and normals are columns without names, of which the values have to say what they are.
    black_is_none
        Whether a file whose colours are all zero has none.
    """

    points: Floats
    colours: Floats | None = None
    normals: Floats | None = None
    guessed: bool = False
    black_is_none: bool = False


class Meaning:
    """What colours and normals of a file turn out to be; `see` takes its rows one after the other."""

    def __init__(self) -> None:
        self._colours = self._normals = self._whole = True
        self._lowest = self._largest = 0.0
        self._needs_colour = False

    def see(self, rows: Rows) -> None:
        """Take some rows into account."""
        self._see_colours(rows)
        if rows.normals is None:
            self._normals = False
        elif rows.guessed and self._normals and len(rows.normals):
            self._normals = bool((np.abs(np.linalg.norm(rows.normals, axis=1) - 1.0) < UNIT).all())

    def _see_colours(self, rows: Rows) -> None:
        values = rows.colours
        if values is None or not self._colours:
            self._colours = False
            return
        with np.errstate(invalid="ignore"):
            whole = bool((values == np.round(values)).all())
        if not np.isfinite(values).all() or (rows.guessed and (not whole or values.max(initial=0.0) > 255.0)):
            self._colours = False
            return
        self._whole = self._whole and whole
        self._lowest = min(self._lowest, float(values.min(initial=0.0)))
        self._largest = max(self._largest, float(values.max(initial=0.0)))
        self._needs_colour = rows.black_is_none

    @property
    def top(self) -> float | None:
        """What the brightest colour is in the file: one for shares, 255 for bytes, 65535 for words; None without."""
        if not self._colours or self._lowest < 0.0 or (self._needs_colour and self._largest == 0.0):
            return None
        largest, whole = self._largest, self._whole
        return next(top for top in (1.0, 255.0, 65535.0, largest) if largest <= top and (top > 1.0 or not whole))

    @property
    def normals(self) -> bool:
        """Whether every row has a normal."""
        return self._normals


# ---------------------------------------------------------------------------------------------------------------- text


def table_rows(path: Path, at_once: int = ROWS_AT_ONCE) -> Iterator[Rows]:
    """Read a table of text, `at_once` lines at a time.

    Raises
    ------
    FileFormatError
        When a line does not have three numbers; the message names it.
    """
    with open(path, encoding="utf-8-sig", errors="replace") as file:
        numbered = ((number, line.strip()) for number, line in enumerate(file, 1))
        lines = ((number, line) for number, line in numbered if line and not line.startswith(COMMENT))
        columns: list[str] | None = None
        first = next(lines, None)
        while first is not None and (names := _header(first[1])) is not None:
            columns = names or columns
            first = next(lines, None)
        if first is None:
            return
        table = _Table(path, columns, len(_cells(first[1])))
        every = itertools.chain([first], lines)
        while some := list(itertools.islice(every, at_once)):
            yield table.rows(some)


class _Table:
    """Where in the lines of a table its values are."""

    def __init__(self, path: Path, columns: Sequence[str] | None, cells: int) -> None:
        self._path, self._guessed = path, columns is None
        named = {name: columns.index(name) for name in columns} if columns is not None else {}
        known = {"x", "y", "z"} <= set(named)
        self._points = [named[axis] for axis in "xyz"] if known else [0, 1, 2]
        self._colours: list[int] | None = None
        self._normals: list[int] | None = None
        if columns is not None:
            self._colours = [named[channel] for channel in "rgb"] if {"r", "g", "b"} <= set(named) else None
            self._normals = [named[f"n{axis}"] for axis in "xyz"] if {"nx", "ny", "nz"} <= set(named) else None
        else:
            # x y z r g b, or with the intensity of a .pts file before the colours; normals at a row's end
            late = path.suffix.lower() == ".pts" or cells in (7, 10)
            self._colours = ([4, 5, 6] if late else [3, 4, 5]) if cells in (6, 7, 9, 10) else None
            self._normals = [-3, -2, -1] if cells in (6, 9) else None

    def rows(self, lines: Sequence[tuple[int, str]]) -> Rows:
        """Return what some numbered lines hold."""
        rows = [_cells(line) for _, line in lines]
        try:
            points = _numbers(rows, self._points)
        except (ValueError, IndexError):
            raise FileFormatError(self._bad_line(lines)) from None
        return Rows(points, _optional(rows, self._colours), _optional(rows, self._normals), self._guessed)

    def _bad_line(self, lines: Sequence[tuple[int, str]]) -> str:
        for number, line in lines:
            cells = _cells(line)
            if len(cells) <= max(self._points) or not all(_is_number(cells[k]) for k in self._points):
                shown = line if len(line) <= 40 else line[:37] + "..."
                return f"'{self._path.name}' cannot be read: line {number}, '{shown}', does not have three numbers."
        return f"'{self._path.name}' cannot be read."


def _header(line: str) -> list[str] | None:
    """Names of the columns if this is a header, none of them if it is a count of points, None for a line of numbers."""
    cells = _cells(line)
    if len(cells) == 1 and cells[0].isdecimal():
        return []
    if any(_is_number(cell) for cell in cells):
        return None
    names = [cell.strip("\"'").lower() for cell in cells]
    known = [NAMES.get(name, name) for name in names]
    return known if {"x", "y", "z"} <= set(known) else None


def _cells(line: str) -> list[str]:
    if ";" in line:  # where a comma is the decimal point
        return [cell.strip() for cell in line.replace(",", ".").split(";")]
    return [cell.strip() for cell in line.split(",")] if "," in line else line.split()


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _numbers(rows: Iterable[Sequence[str]], places: Sequence[int]) -> Floats:
    return np.array([[row[k] for k in places] for row in rows], dtype=np.float64).reshape(-1, 3)


def _optional(rows: Iterable[Sequence[str]], places: Sequence[int] | None) -> Floats | None:
    """Columns that a row may lack."""
    try:
        return None if places is None else _numbers(rows, places)
    except (ValueError, IndexError):
        return None


def obj_rows(path: Path, at_once: int = ROWS_AT_ONCE) -> Iterator[Rows]:
    """Read the points of an .obj file, its lines "v x y z".

    Raises
    ------
    FileFormatError
        When one does not have three numbers.
    """
    with open(path, encoding="utf-8", errors="replace") as file:
        vertices = (words[1:4] for line in file if (words := line.split())[:1] == ["v"])
        while some := list(itertools.islice(vertices, at_once)):
            try:
                points = np.array(some, dtype=np.float64)
            except ValueError:
                points = np.zeros(0)
            if points.shape != (len(some), 3):
                raise FileFormatError(f"'{path.name}' cannot be read: a vertex does not have three numbers.")
            yield Rows(points)

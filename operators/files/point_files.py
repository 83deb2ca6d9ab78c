"""Files that hold points only: text with columns, .pcd, and what the packages laspy and pye57 read.  Needs no Blender.

Coordinates are read in double precision: those of surveys have ten digits.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...solver.errors import FileFormatError, InputError

Floats = NDArray[np.float64]

TEXT_TABLES = (".xyz", ".txt", ".csv", ".asc", ".pts")
"""Files of lines that begin with three numbers, separated by blanks, commas or semicolons."""

COMMENT = ("#", "//", "%")
NAMES = {"red": "r", "green": "g", "blue": "b", "//x": "x", "easting": "x", "northing": "y", "elevation": "z"}
NAMES |= {f"normal{joint}{axis}": f"n{axis}" for joint in ("", "_") for axis in "xyz"}
"""What headers call the columns x, y, z, r, g, b, nx, ny, nz otherwise."""

UNIT = 0.02
"""Three columns without names hold normals if their lengths differ from one by less than this in every row."""

PACKAGES = {".las": "laspy", ".laz": "laspy[lazrs]", ".e57": "pye57"}
"""What has to be installed to read these."""

E57_NORMALS = ("nor:normalX", "nor:normalY", "nor:normalZ")
E57_INVALID = ("cartesianInvalidState", "sphericalInvalidState")
"""Fields of a scan: normals, and what marks points that were not measured."""


@dataclass(frozen=True)
class PointFile:
    """Points (P, 3), and as far as the file has them their colours, sRGB from 0 to 1, and normals, (P, 3) or None."""

    points: Floats
    colours: Floats | None = None
    normals: Floats | None = None


def read_point_file(path: Path) -> PointFile:
    """Read a file of one of the kinds in `READERS`.

    Raises
    ------
    InputError
        When it holds no points.
    FileFormatError
        When it cannot be read, or needs a package that is not installed.
    """
    found = READERS[path.suffix.lower()](path)
    if not len(found.points):
        raise InputError(f"'{path.name}' holds no points.")
    return found


# ---------------------------------------------------------------------------------------------------------------- text


def _read_table(path: Path) -> PointFile:
    with open(path, encoding="utf-8-sig", errors="replace") as file:
        lines = [(number, line.strip()) for number, line in enumerate(file, 1)]
    lines = [(number, line) for number, line in lines if line and not line.startswith(COMMENT)]
    columns: list[str] | None = None
    while lines and (names := _header(lines[0][1])) is not None:
        columns = names or columns
        lines = lines[1:]
    named = columns is not None and {"x", "y", "z"} <= set(columns)
    first = [columns.index(axis) for axis in "xyz"] if columns is not None and named else [0, 1, 2]
    rows = [_cells(line) for _, line in lines]
    try:
        points = np.array([[row[k] for k in first] for row in rows], dtype=np.float64).reshape(-1, 3)
    except (ValueError, IndexError):
        raise FileFormatError(_bad_line(path, lines, first)) from None
    return PointFile(points, _table_colours(rows, columns, path.suffix.lower()), _table_normals(rows, columns))


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


def _bad_line(path: Path, lines: Sequence[tuple[int, str]], columns: Sequence[int]) -> str:
    for number, line in lines:
        cells = _cells(line)
        if len(cells) <= max(columns) or not all(_is_number(cells[k]) for k in columns):
            shown = line if len(line) <= 40 else line[:37] + "..."
            return f"'{path.name}' cannot be read: line {number}, '{shown}', does not have three numbers."
    return f"'{path.name}' cannot be read."


def _table_colours(rows: Sequence[Sequence[str]], columns: Sequence[str] | None, ending: str) -> Floats | None:
    """Colours of columns named r, g, b; without names, of three whole numbers up to 255 behind the coordinates."""
    if columns is not None and {"r", "g", "b"} <= set(columns):
        places = [columns.index(channel) for channel in "rgb"]
    elif columns is None and rows and len(rows[0]) in (6, 7, 9, 10):
        # x y z r g b, or with the intensity of a .pts file before the colours
        places = [4, 5, 6] if ending == ".pts" or len(rows[0]) in (7, 10) else [3, 4, 5]
    else:
        return None
    try:
        values = np.array([[row[k] for k in places] for row in rows], dtype=np.float64)
    except (ValueError, IndexError):
        return None
    if columns is None and ((values != np.round(values)) | (values < 0) | (values > 255)).any():
        return None  # normals, or anything else
    return _scaled(values)


def _table_normals(rows: Sequence[Sequence[str]], columns: Sequence[str] | None) -> Floats | None:
    """Normals of columns named nx, ny, nz; without names, of three numbers of length one at a row's end."""
    if columns is not None and {"nx", "ny", "nz"} <= set(columns):
        places = [columns.index(f"n{axis}") for axis in "xyz"]
    elif columns is None and rows and len(rows[0]) in (6, 9):
        places = [-3, -2, -1]
    else:
        return None
    try:
        values = np.array([[row[k] for k in places] for row in rows], dtype=np.float64)
    except (ValueError, IndexError):
        return None
    unit = bool((np.abs(np.linalg.norm(values, axis=1) - 1.0) < UNIT).all())
    return values if columns is not None or unit else None


def _scaled(values: Floats) -> Floats | None:
    """Bring colours to 0 to 1, from bytes, words or shares."""
    if not np.isfinite(values).all() or values.min(initial=0.0) < 0.0:
        return None
    largest = float(values.max(initial=0.0))
    whole = bool((values == np.round(values)).all())
    return values / next(top for top in (1.0, 255.0, 65535.0, largest) if largest <= top and (top > 1.0 or not whole))


# ----------------------------------------------------------------------------------------------------------------- PCD


def _read_pcd(path: Path) -> PointFile:
    content = path.read_bytes()
    start = re.search(rb"^DATA\s+(\S+)[^\n]*\n", content, re.MULTILINE)
    if start is None:
        raise FileFormatError(f"'{path.name}' cannot be read: it has no line that begins with DATA.")
    words = [line.split() for line in content[: start.start()].decode("ascii", "replace").splitlines()]
    header = {line[0]: line[1:] for line in words if line}
    try:
        kind = _pcd_kind(header)
        count = int(header["POINTS"][0]) if "POINTS" in header else int(header["WIDTH"][0]) * int(header["HEIGHT"][0])
        table = _pcd_table(content[start.end() :], start.group(1).decode(), kind, count)
    except (KeyError, ValueError, IndexError):
        raise FileFormatError(f"'{path.name}' cannot be read: its header and its data do not agree.") from None
    points = np.stack([table[axis].astype(np.float64) for axis in "xyz"], axis=1)
    named = [f"normal_{axis}" for axis in "xyz"]
    normals = np.stack([table[name] for name in named], axis=1) if {*named} <= {*table.dtype.names} else None
    return PointFile(points, _packed_colours(table), None if normals is None else normals.astype(np.float64))


def _pcd_kind(header: dict[str, list[str]]) -> np.dtype[Any]:
    counts = header.get("COUNT", ["1"] * len(header["FIELDS"]))
    letters = {"F": "f", "I": "i", "U": "u"}
    fields = zip(header["FIELDS"], header["TYPE"], header["SIZE"], counts, strict=True)
    listed = [(f"{n}{k}" if n == "_" else n, f"<{letters[t]}{s}", (int(c),)) for k, (n, t, s, c) in enumerate(fields)]
    return np.dtype([(name, form) if shape == (1,) else (name, form, shape) for name, form, shape in listed])


def _pcd_table(data: bytes, how: str, kind: np.dtype[Any], count: int) -> Any:
    if how == "binary":
        return np.frombuffer(data, dtype=kind, count=count)
    if how == "ascii":
        rows = [tuple(line.split()) for line in data.decode("ascii", "replace").splitlines() if line.strip()]
        wide = [name for name in kind.names or () for _ in range(int(np.prod(kind[name].shape, dtype=int)))]
        numbers = np.array(rows[:count], dtype=np.float64).reshape(count, len(wide))
        table = np.zeros(count, dtype=kind)
        for name in kind.names or ():
            if kind[name].shape == ():
                table[name] = numbers[:, wide.index(name)]
        return table
    if how != "binary_compressed":
        raise ValueError(how)
    packed, size = np.frombuffer(data, dtype="<u4", count=2)
    unpacked, table, place = _lzf(data[8 : 8 + int(packed)], int(size)), np.zeros(count, dtype=kind), 0
    for name in kind.names or ():  # all values of a field, then those of the next
        field = kind[name]
        table[name] = np.frombuffer(unpacked, dtype=field, count=count, offset=place)
        place += field.itemsize * count
    return table


def _lzf(packed: bytes, size: int) -> bytes:
    """Unpack what the library LibLZF packed: runs of bytes, and references to earlier ones."""
    result, place = bytearray(), 0
    while place < len(packed):
        control = packed[place]
        place += 1
        if control < 32:
            result += packed[place : place + control + 1]
            place += control + 1
            continue
        length = control >> 5
        if length == 7:
            length += packed[place]
            place += 1
        start = len(result) - ((control & 31) << 8) - packed[place] - 1
        place += 1
        for _ in range(length + 2):
            result.append(result[start])
            start += 1
    if len(result) != size:
        raise ValueError("size")
    return bytes(result)


def _packed_colours(table: Any) -> Floats | None:
    name = next((name for name in ("rgb", "rgba") if name in table.dtype.names), None)
    if name is None or table[name].dtype.itemsize != 4:
        return None
    bits = np.ascontiguousarray(table[name]).view(np.uint32)
    return np.stack([bits >> 16 & 255, bits >> 8 & 255, bits & 255], axis=1) / 255.0


# ------------------------------------------------------------------------------------------------------ other packages


def _read_las(path: Path) -> PointFile:
    las = _package("laspy", path).read(str(path))
    points = np.stack([np.asarray(las[axis], dtype=np.float64) for axis in "xyz"], axis=1)
    if not {"red", "green", "blue"} <= set(las.point_format.dimension_names):
        return PointFile(points)
    colours = np.stack([np.asarray(las[name], dtype=np.float64) for name in ("red", "green", "blue")], axis=1)
    return PointFile(points, _scaled(colours) if colours.any() else None)


def _read_e57(path: Path) -> PointFile:
    package = _package("pye57", path)
    file = package.E57(str(path))
    points, colours, normals = [], [], []
    for number in range(file.scan_count):
        scan = file.read_scan(number, ignore_missing_fields=True, colors=True)
        points.append(np.stack([scan[f"cartesian{axis}"] for axis in "XYZ"], axis=1).astype(np.float64))
        if "colorRed" in scan:
            colours.append(np.stack([scan[f"color{name}"] for name in ("Red", "Green", "Blue")], axis=1))
        normals += _e57_normals(package.libe57, file, number)
    whole = np.concatenate(points) if points else np.zeros((0, 3))
    coloured, directed = (len(whole) > 0 and sum(map(len, each)) == len(whole) for each in (colours, normals))
    return PointFile(
        whole,
        _scaled(np.concatenate(colours).astype(np.float64)) if coloured else None,
        np.concatenate(normals) if directed else None,
    )


def _e57_normals(library: Any, file: Any, number: int) -> list[Floats]:
    """Normals of a scan's valid points, (P, 3), turned as the scan is; nothing where it has none.

    They are an extension of the format that `read_scan` leaves out.
    """
    header = file.get_header(number)
    if not {*E57_NORMALS} <= {*header.point_fields}:
        return []
    wanted = [*E57_NORMALS, *(name for name in E57_INVALID if name in header.point_fields)]
    columns, buffers = np.zeros((len(wanted), header.point_count)), library.VectorSourceDestBuffer()
    for name, column in zip(wanted, columns, strict=True):
        buffers.append(library.SourceDestBuffer(file.image_file, name, column, header.point_count, True, True))
    header.points.reader(buffers).read()
    valid = ~columns[3:].any(axis=0)
    return [columns[:3, valid].T @ header.rotation_matrix.T]


def _package(name: str, path: Path) -> Any:
    """Import a package that is not needed otherwise."""
    try:
        return import_module(name)
    except ImportError:
        wanted = PACKAGES[path.suffix.lower()]
        text = f"'{path.name}' needs the Python package {name}: pip install \"{wanted}\"."
        raise FileFormatError(text) from None


def _wrapped(read: Callable[[Path], PointFile]) -> Callable[[Path], PointFile]:
    """Let whatever another package raises become one sentence."""

    def wrapped(path: Path) -> PointFile:
        try:
            return read(path)
        except FileFormatError:
            raise
        except Exception as error:  # these packages document no errors of their own
            reason = str(error).strip().splitlines()
            raise FileFormatError(f"'{path.name}' cannot be read: {reason[0] if reason else error!r}") from error

    return wrapped


READERS: dict[str, Callable[[Path], PointFile]] = {
    **dict.fromkeys(TEXT_TABLES, _read_table),
    ".pcd": _read_pcd,
    ".las": _wrapped(_read_las),
    ".laz": _wrapped(_read_las),
    ".e57": _wrapped(_read_e57),
}
"""What reads files of each ending."""

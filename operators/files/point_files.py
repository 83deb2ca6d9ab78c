"""Files that hold points only, and points of .obj and .ply files: read as a whole or in parts.  Needs no Blender.

What the packages laspy and pye57 read is read here; text and binary files are in `point_rows` and `binary_rows`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from ...solver.errors import FileFormatError, InputError
from .binary_rows import las_head, las_rows, pcd_count, pcd_rows, ply_count, ply_rows
from .point_rows import ROWS_AT_ONCE, TEXT_TABLES, Floats, Meaning, Rows, obj_rows, table_rows

PACKAGES = {".las": "laspy", ".laz": "laspy[lazrs]", ".e57": "pye57"}
"""What has to be installed to read these; a .las only where it is packed."""

E57_NORMALS = ("nor:normalX", "nor:normalY", "nor:normalZ")
E57_INVALID = ("cartesianInvalidState", "sphericalInvalidState")
"""Fields of a scan: normals, and what marks points that were not measured."""

SAMPLE = 1 << 16
"""Bytes of text from which its number of lines is guessed."""


@dataclass(frozen=True)
class PointFile:
    """Points (P, 3), and as far as the file has them their colours, sRGB from 0 to 1, and normals, (P, 3) or None."""

    points: Floats
    colours: Floats | None = None
    normals: Floats | None = None


def read_point_file(path: Path) -> PointFile:
    """Read a file of one of the kinds in `PARTS`.

    Raises
    ------
    InputError
        When it holds no points.
    FileFormatError
        When it cannot be read, or needs a package that is not installed.
    """
    parts = PointParts(path)
    every = list(parts)
    top = parts.meaning.top
    return PointFile(
        np.concatenate([rows.points for rows in every]),
        None if top is None else np.concatenate([rows.colours for rows in every if rows.colours is not None]) / top,
        np.concatenate([rows.normals for rows in every if rows.normals is not None]) if parts.meaning.normals else None,
    )


class PointParts:
    """A file of points that is read in parts, again each time that it is iterated over.

    Parameters
    ----------
    path
        Of one of the kinds in `PARTS`.
    at_once
        Rows that are read at once, where the file leaves the choice.

    Attributes
    ----------
    meaning
        What its colours and normals are, once all was read.
    """

    def __init__(self, path: Path, at_once: int = ROWS_AT_ONCE) -> None:
        self._path, self._at_once = path, at_once
        self.meaning = Meaning()

    def __iter__(self) -> Iterator[Rows]:
        """Yield its rows; raises `FileFormatError` where they cannot be read, and `InputError` where there are none."""
        self.meaning, count = Meaning(), 0
        for rows in PARTS[self._path.suffix.lower()](self._path, self._at_once):
            self.meaning.see(rows)
            count += len(rows.points)
            yield rows
        if not count:
            raise InputError(f"'{self._path.name}' holds no points.")


def in_parts(path: Path) -> bool:
    """Whether a file can be read in parts: not where rows before the points differ in length."""
    ending = path.suffix.lower()
    return ending in PARTS and (ending != ".ply" or ply_count(path) is not None)


def count_of(path: Path) -> int:
    """Say how many points a file has, from its head; of text guess it from how long its first lines are.

    Zero where the head does not say: whoever reads the file will find out.
    """
    ending = path.suffix.lower()
    try:
        if ending in (*TEXT_TABLES, ".obj"):
            with open(path, "rb") as file:
                sample = file.read(SAMPLE)
            return path.stat().st_size * sample.count(b"\n") // max(len(sample), 1)
        return COUNTS[ending](path) or 0
    except (FileFormatError, OSError):
        return 0


# ------------------------------------------------------------------------------------------------------ other packages


def _las_rows(path: Path, at_once: int) -> Iterator[Rows]:
    if las_head(path) is not None:
        yield from las_rows(path, at_once)
        return
    with _package("laspy", path).open(str(path)) as las:
        coloured = {"red", "green", "blue"} <= set(las.header.point_format.dimension_names)
        for part in las.chunk_iterator(at_once):
            points = np.stack([np.asarray(part[axis], dtype=np.float64) for axis in "xyz"], axis=1)
            names = ("red", "green", "blue") if coloured else ()
            colours = [np.asarray(part[name], dtype=np.float64) for name in names]
            yield Rows(points, np.stack(colours, axis=1) if coloured else None, black_is_none=True)


def _las_count(path: Path) -> int:
    head = las_head(path)
    if head is not None:
        return head[0]
    with _package("laspy", path).open(str(path)) as las:
        return int(las.header.point_count)


def _e57_rows(path: Path, at_once: int) -> Iterator[Rows]:
    """Read an .e57, a scan at a time: `pye57` places each as a whole."""
    package = _package("pye57", path)
    file = package.E57(str(path))
    for number in range(file.scan_count):
        scan = file.read_scan(number, ignore_missing_fields=True, colors=True)
        points = np.stack([scan[f"cartesian{axis}"] for axis in "XYZ"], axis=1).astype(np.float64)
        names, colours = [f"color{name}" for name in ("Red", "Green", "Blue")], None
        if "colorRed" in scan:
            colours = np.stack([scan[name] for name in names], axis=1).astype(np.float64)
        normals = _e57_normals(package.libe57, file, number)
        for start in range(0, len(points), at_once):
            part = slice(start, start + at_once)
            yield Rows(
                points[part],
                None if colours is None else colours[part],
                None if normals is None or len(normals) != len(points) else normals[part],
            )


def _e57_count(path: Path) -> int:
    file = _package("pye57", path).E57(str(path))
    return sum(file.get_header(number).point_count for number in range(file.scan_count))


def _e57_normals(library: Any, file: Any, number: int) -> Floats | None:
    """Normals of a scan's valid points, (P, 3), turned as the scan is; None where it has none.

    They are an extension of the format that `read_scan` leaves out.
    """
    header = file.get_header(number)
    if not {*E57_NORMALS} <= {*header.point_fields}:
        return None
    wanted = [*E57_NORMALS, *(name for name in E57_INVALID if name in header.point_fields)]
    columns, buffers = np.zeros((len(wanted), header.point_count)), library.VectorSourceDestBuffer()
    for name, column in zip(wanted, columns, strict=True):
        buffers.append(library.SourceDestBuffer(file.image_file, name, column, header.point_count, True, True))
    header.points.reader(buffers).read()
    valid = ~columns[3:].any(axis=0)
    return np.asarray(columns[:3, valid].T @ header.rotation_matrix.T)


def _package(name: str, path: Path) -> Any:
    """Import a package that is not needed otherwise."""
    try:
        return import_module(name)
    except ImportError:
        wanted = PACKAGES[path.suffix.lower()]
        text = f"'{path.name}' needs the Python package {name}: pip install \"{wanted}\"."
        raise FileFormatError(text) from None


Reader = Callable[[Path, int], Iterator[Rows]]


def _wrapped(read: Reader) -> Reader:
    """Let whatever another package raises become one sentence."""

    def wrapped(path: Path, at_once: int) -> Iterator[Rows]:
        try:
            yield from read(path, at_once)
        except FileFormatError:
            raise
        except Exception as error:  # these packages document no errors of their own
            reason = str(error).strip().splitlines()
            raise FileFormatError(f"'{path.name}' cannot be read: {reason[0] if reason else error!r}") from error

    return wrapped


READERS: dict[str, Reader] = {
    **dict.fromkeys(TEXT_TABLES, table_rows),
    ".pcd": pcd_rows,
    ".las": _wrapped(_las_rows),
    ".laz": _wrapped(_las_rows),
    ".e57": _wrapped(_e57_rows),
}
"""What reads files of each ending, some rows at a time."""

PARTS: dict[str, Reader] = {**READERS, ".obj": obj_rows, ".ply": ply_rows}
"""The same for all that can be read in parts; the two that hold meshes, too, are otherwise read by Blender."""

COUNTS: dict[str, Callable[[Path], int | None]] = {
    ".pcd": pcd_count,
    ".las": _las_count,
    ".laz": _las_count,
    ".e57": _e57_count,
    ".ply": ply_count,
}
"""What says how many points there are without reading them."""

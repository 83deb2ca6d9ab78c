"""Rows of binary point files, some at a time: .ply, .las and .pcd stay in their files, mapped into memory.

The layouts are those of the PLY description by Greg Turk, the LAS specification of the ASPRS (1.0 to 1.4) and that of
the Point Cloud Library.  Needs no Blender and no other package.
"""

from __future__ import annotations

import itertools
import re
import struct
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...solver.errors import FileFormatError
from .large import Element, read_header, row_type
from .point_rows import ROWS_AT_ONCE, Floats, Rows

LAS_COLOURS = {2: 20, 3: 28, 5: 28, 7: 30, 8: 30, 10: 30}
"""Where in a record the colours are, by the format of the points; other formats have none."""

LAS_COMPRESSED = 0xC0
"""Bits of that number which say that the points are packed."""

SHORT = "'{}' cannot be read: it ends before its last point."


def _sliced(table: NDArray[Any], at_once: int) -> Iterator[NDArray[Any]]:
    """Rows of a table, read from its file when they are taken."""
    return (np.array(table[start : start + at_once]) for start in range(0, len(table), at_once))


def _columns(table: NDArray[Any], names: Iterable[str]) -> Floats | None:
    """Three columns by their names, (n, 3); None where one is missing."""
    fields = table.dtype.names or ()
    columns = [table[name].astype(np.float64) for name in names if name in fields]
    return np.stack(columns, axis=1) if len(columns) == 3 else None


# ----------------------------------------------------------------------------------------------------------------- PLY


def ply_count(path: Path) -> int | None:
    """Return how many points a .ply says it has; None where it cannot be read in parts."""
    try:
        with open(path, "rb") as file:
            head = read_header(file)
    except (ValueError, IndexError):
        return None
    for element in head[1] if head else ():
        if any(not isinstance(kind, str) for _, kind in element.fields):
            return None  # rows of different lengths before the points
        if element.name == "vertex":
            return element.count if {"x", "y", "z"} <= {name for name, _ in element.fields} else None
    return None


def ply_rows(path: Path, at_once: int = ROWS_AT_ONCE) -> Iterator[Rows]:
    """Read the vertices of a .ply that `ply_count` knows, binary or text.

    Raises
    ------
    FileFormatError
        When the file ends too early, or a line of text is no row of numbers.
    """
    with open(path, "rb") as file:
        order, elements = read_header(file) or ("", [])
        number = next(k for k, element in enumerate(elements) if element.name == "vertex")
        before, vertex = elements[:number], elements[number]
        start = file.tell()
        if not order:
            skipped = sum(element.count for element in before)
            yield from map(_ply_columns, _text_rows(path, file, vertex, skipped, at_once))
            return
        for element in before:
            start += element.count * _row(file, start, order, element).itemsize
        row = _row(file, start, order, vertex)
        if start + row.itemsize * vertex.count > path.stat().st_size:
            raise FileFormatError(SHORT.format(path.name))
    if vertex.count:
        yield from map(_ply_columns, _sliced(np.memmap(path, row, "r", start, (vertex.count,)), at_once))


def _row(file: Any, start: int, order: str, element: Element) -> np.dtype[Any]:
    kind = row_type(file, start, order, element)
    assert kind is not None, "ply_count has looked at the fields"
    return kind


def _text_rows(path: Path, file: Any, vertex: Element, skipped: int, at_once: int) -> Iterator[NDArray[Any]]:
    kind = np.dtype([(name, "f8") for name, _ in vertex.fields])
    lines = (line for line in file if line.strip())
    left = vertex.count
    for _ in itertools.islice(lines, skipped):
        pass
    while left:
        some = [tuple(line.split()) for line in itertools.islice(lines, min(left, at_once))]
        if not some:
            raise FileFormatError(SHORT.format(path.name))
        try:
            yield np.array(some, dtype=kind)
        except ValueError:
            row = next(row for row in some if not _is_row(row, len(vertex.fields)))
            text = b" ".join(row).decode("utf-8", "replace")
            raise FileFormatError(f"'{path.name}' cannot be read: '{text}' is no row of its points.") from None
        left -= len(some)


def _is_row(words: Sequence[bytes], count: int) -> bool:
    try:
        return len([float(word) for word in words]) == count
    except ValueError:
        return False


def _ply_columns(table: NDArray[Any]) -> Rows:
    points = _columns(table, "xyz")
    assert points is not None, "ply_count has looked for them"
    return Rows(points, _columns(table, ("red", "green", "blue")), _columns(table, ("nx", "ny", "nz")))


# ----------------------------------------------------------------------------------------------------------------- LAS


def las_head(path: Path) -> tuple[int, int, int, int, Floats] | None:
    """Return what is needed to read a .las: its number of points, where they begin, the length and the format of a
    record, and scales and offsets of the coordinates, (2, 3).

    None where the file is packed or no .las at all, which is left to a package.
    """
    with open(path, "rb") as file:
        head = file.read(375)
    if len(head) < 227 or head[:4] != b"LASF" or head[104] & LAS_COMPRESSED:
        return None
    start, kind, length, count = struct.unpack_from("<I4xBHI", head, 96)
    if head[24:26] >= b"\x01\x04" and len(head) >= 255:
        count = struct.unpack_from("<Q", head, 247)[0] or count
    if length < max(12, LAS_COLOURS.get(kind, 0) + 6 * (kind in LAS_COLOURS)):
        return None
    return count, start, length, kind, np.array(struct.unpack_from("<6d", head, 131)).reshape(2, 3)


def las_rows(path: Path, at_once: int = ROWS_AT_ONCE) -> Iterator[Rows]:
    """Read the points of a .las that `las_head` knows.

    Raises
    ------
    FileFormatError
        When the file ends too early.
    """
    head = las_head(path)
    assert head is not None, "whoever calls has looked at the head"
    count, start, length, kind, (scale, offset) = head
    if start + count * length > path.stat().st_size:
        raise FileFormatError(SHORT.format(path.name))
    if not count:
        return
    fields: list[tuple[str, Any, int]] = [("place", ("<i4", (3,)), 0)]
    if kind in LAS_COLOURS:
        fields.append(("colour", ("<u2", (3,)), LAS_COLOURS[kind]))
    names, forms, places = zip(*fields, strict=True)
    row = np.dtype({"names": names, "formats": forms, "offsets": places, "itemsize": length})
    for part in _sliced(np.memmap(path, row, "r", start, (count,)), at_once):
        colours = part["colour"].astype(np.float64) if kind in LAS_COLOURS else None
        yield Rows(part["place"] * scale + offset, colours, black_is_none=True)


# ----------------------------------------------------------------------------------------------------------------- PCD


def pcd_count(path: Path) -> int:
    """Return how many points a .pcd says it has."""
    with open(path, "rb") as file:
        header, _ = _pcd_header(path, file)
    try:
        return _pcd_points(header)
    except (KeyError, ValueError, IndexError):
        raise FileFormatError(_torn(path)) from None


def pcd_rows(path: Path, at_once: int = ROWS_AT_ONCE) -> Iterator[Rows]:
    """Read the points of a .pcd; one that is packed is unpacked as a whole.

    Raises
    ------
    FileFormatError
        When the file has no DATA, or header and data do not agree.
    """
    try:
        with open(path, "rb") as file:
            header, how = _pcd_header(path, file)
            kind, count = _pcd_kind(header), _pcd_points(header)
            for table in _pcd_tables(path, file, how, kind, count, at_once):
                yield _pcd_columns(table)
    except (KeyError, ValueError, IndexError):
        raise FileFormatError(_torn(path)) from None


def _torn(path: Path) -> str:
    return f"'{path.name}' cannot be read: its header and its data do not agree."


def _pcd_header(path: Path, file: Any) -> tuple[dict[str, list[str]], str]:
    """Words of each line of the header by the first, and how the data are written; the file stands behind it."""
    header: dict[str, list[str]] = {}
    for line in file:
        words = line.decode("ascii", "replace").split()
        if re.match(rb"DATA\s+\S", line) and line.endswith(b"\n"):
            return header, words[1]
        if words:
            header[words[0]] = words[1:]
    raise FileFormatError(f"'{path.name}' cannot be read: it has no line that begins with DATA.")


def _pcd_points(header: dict[str, list[str]]) -> int:
    if "POINTS" in header:
        return int(header["POINTS"][0])
    return int(header["WIDTH"][0]) * int(header["HEIGHT"][0])


def _pcd_kind(header: dict[str, list[str]]) -> np.dtype[Any]:
    counts = header.get("COUNT", ["1"] * len(header["FIELDS"]))
    letters = {"F": "f", "I": "i", "U": "u"}
    fields = zip(header["FIELDS"], header["TYPE"], header["SIZE"], counts, strict=True)
    listed = [(f"{n}{k}" if n == "_" else n, f"<{letters[t]}{s}", (int(c),)) for k, (n, t, s, c) in enumerate(fields)]
    return np.dtype([(name, form) if shape == (1,) else (name, form, shape) for name, form, shape in listed])


def _pcd_tables(
    path: Path, file: Any, how: str, kind: np.dtype[Any], count: int, at_once: int
) -> Iterator[NDArray[Any]]:
    start = file.tell()
    if how == "ascii":
        yield from _pcd_text(file, kind, count, at_once)
    elif how == "binary" and count:
        if start + count * kind.itemsize > path.stat().st_size:
            raise ValueError(how)
        yield from _sliced(np.memmap(path, kind, "r", start, (count,)), at_once)
    elif how == "binary_compressed":
        yield from _sliced(_unpacked(file.read(), kind, count), at_once)
    elif how != "binary":
        raise ValueError(how)


def _pcd_text(file: Any, kind: np.dtype[Any], count: int, at_once: int) -> Iterator[NDArray[Any]]:
    wide = [name for name in kind.names or () for _ in range(int(np.prod(kind[name].shape, dtype=int)))]
    lines, left = (line for line in file if line.strip()), count
    while left:
        rows = [line.split() for line in itertools.islice(lines, min(left, at_once))]
        numbers = np.array(rows, dtype=np.float64).reshape(len(rows), len(wide))
        if not rows:
            raise ValueError("rows")
        table = np.zeros(len(rows), dtype=kind)
        for name in kind.names or ():
            if kind[name].shape == ():
                table[name] = numbers[:, wide.index(name)]
        yield table
        left -= len(rows)


def _unpacked(data: bytes, kind: np.dtype[Any], count: int) -> NDArray[Any]:
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


def _pcd_columns(table: NDArray[Any]) -> Rows:
    points = np.stack([table[axis].astype(np.float64) for axis in "xyz"], axis=1)
    return Rows(points, _packed_colours(table), _columns(table, [f"normal_{axis}" for axis in "xyz"]))


def _packed_colours(table: NDArray[Any]) -> Floats | None:
    name = next((name for name in ("rgb", "rgba") if name in (table.dtype.names or ())), None)
    if name is None or table[name].dtype.itemsize != 4:
        return None
    bits = np.ascontiguousarray(table[name]).view(np.uint32)
    return np.stack([bits >> 16 & 255, bits >> 8 & 255, bits & 255], axis=1).astype(np.float64)

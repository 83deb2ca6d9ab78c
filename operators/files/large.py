"""Meshes that are too large to be loaded: arrays mapped into memory, and binary .ply read and written in parts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ...solver.atomic_files import atomic_output
from ...solver.errors import FileFormatError
from .plain import PlainMesh, read_plain, write_plain

ROWS_AT_ONCE = 1 << 20

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ORDERS = {b"binary_little_endian": "<", b"binary_big_endian": ">", b"ascii": ""}
_LONGEST_LINE = 1000


@dataclass(frozen=True)
class LargeFile:
    """Positions (V, 3) and faces of a file: (F, n), or a list of polygons; mapped into memory where it can be."""

    vertices: NDArray[Any]
    faces: Any


def read_large(path: Path) -> LargeFile:
    """Read a mesh file: a binary .ply of faces with equally many corners stays in its file, any other is loaded.

    Raises
    ------
    InputError, FileFormatError
        As `read_plain`.
    """
    if path.suffix.lower() == ".ply" and path.is_file():
        mapped = _mapped_ply(path)
        if mapped is not None:
            return mapped
    mesh = read_plain(path)
    sizes = np.unique(mesh.sizes)
    faces = mesh.corners.reshape(-1, sizes[0]) if len(sizes) == 1 else mesh.polygons()
    return LargeFile(np.asarray(mesh.vertices), faces)


@dataclass(frozen=True)
class Element:
    """A kind of row: its name, how many there are, and its fields; a list is a field with a pair of types."""

    name: str
    count: int
    fields: list[tuple[str, Any]]


def _mapped_ply(path: Path) -> LargeFile | None:
    """Map a binary .ply into memory; None where its faces differ in size, or it is not a binary one."""
    with open(path, "rb") as file:
        order, elements = read_header(file) or ("", [])
        if not order:
            return None
        start, found = file.tell(), {}
        for element in elements:
            row = row_type(file, start, order, element)
            if row is None or start + row.itemsize * element.count > path.stat().st_size:
                return None
            if element.count:
                found[element.name] = np.memmap(path, row, "r", start, (element.count,))
            start += row.itemsize * element.count
    vertices, faces = found.get("vertex"), found.get("face")
    if vertices is None or faces is None or not {"x", "y", "z"} <= set(vertices.dtype.names or ()):
        return None
    if any((part["size"] != faces["size"][0]).any() for part in _parts(faces)):
        return None
    return LargeFile(_columns(vertices), faces["list"])


def _columns(vertices: NDArray[Any]) -> NDArray[Any]:
    """The positions as (V, 3): a view where x, y and z lie side by side, else a copy."""
    kinds: Mapping[str, Any] = vertices.dtype.fields or {}
    kind, start = kinds["x"][0], kinds["x"][1]
    beside = [(kinds[axis][0], kinds[axis][1]) for axis in "xyz"]
    if beside == [(kind, start + n * kind.itemsize) for n in range(3)]:
        packed = np.dtype(
            {"names": ["p"], "formats": [(kind, (3,))], "offsets": [start], "itemsize": vertices.itemsize}
        )
        view: NDArray[Any] = vertices.view(packed)["p"]
        return view
    return np.stack([vertices[axis] for axis in "xyz"], axis=1)


def read_header(file: IO[bytes]) -> tuple[str, list[Element]] | None:
    """Read the head of a .ply: the order of its bytes, empty for one of text, and its elements; None if it is none."""
    if file.readline(_LONGEST_LINE).strip() != b"ply":
        return None
    order, elements = None, []
    while (line := file.readline(_LONGEST_LINE)) and line.strip() != b"end_header":
        words = line.split()
        if words[:1] == [b"format"]:
            order = _ORDERS.get(words[1])
        elif words[:1] == [b"element"]:
            elements.append(Element(words[1].decode(), int(words[2]), []))
        elif words[:1] == [b"property"]:
            kinds = [_TYPES.get(word.decode()) for word in words[1:-1] if word != b"list"]
            if None in kinds or not elements:
                return None
            elements[-1].fields.append((words[-1].decode(), tuple(kinds) if words[1] == b"list" else kinds[0]))
    return (order, elements) if order is not None and line else None


def row_type(file: IO[bytes], start: int, order: str, element: Element) -> np.dtype[Any] | None:
    """The type of an element's rows; a list is taken to have as many entries in each row as in the first."""
    columns: list[Any] = []
    for name, kind in element.fields:
        if isinstance(kind, str):
            columns.append((name, order + kind))
            continue
        if any(column[0] == "size" for column in columns):
            return None
        counter = np.dtype(order + kind[0])
        file.seek(start + np.dtype(columns).itemsize)
        entries = np.frombuffer(file.read(counter.itemsize), counter)
        length = int(entries[0]) if len(entries) and element.count else 0
        columns += [("size", counter), ("list", order + kind[1], (length,))]
    return np.dtype(columns) if columns else None


def write_large(path: Path, source: LargeFile, vertices: NDArray[Any], values: Mapping[str, NDArray[Any]]) -> None:
    """Write a mesh with values of its vertices by name: a .ply in parts, any other kind as `write_plain` does.

    Raises
    ------
    FileFormatError, OSError
        As `write_plain`.
    """
    faces = source.faces
    if path.suffix.lower() != ".ply" or not isinstance(faces, np.ndarray):
        corners = np.concatenate([np.asarray(face) for face in faces]) if isinstance(faces, list) else faces.ravel()
        sizes = np.array([len(face) for face in faces], dtype=np.int64)
        write_plain(path, PlainMesh(np.array(vertices), np.array(corners), sizes, dict(values)))
        return
    if len(vertices) > np.iinfo(np.int32).max:
        raise FileFormatError(f"'{path.name}' can number {np.iinfo(np.int32).max} vertices at most.")
    with atomic_output(path) as draft, open(draft, "wb") as file:
        _write_ply(file, vertices, values, faces)


def _write_ply(file: IO[bytes], vertices: NDArray[Any], values: Mapping[str, NDArray[Any]], faces: Any) -> None:
    names = {"f4": "float", "f8": "double", "i4": "int"}
    columns = [(axis, f"<f{vertices.dtype.itemsize}") for axis in "xyz"]
    columns += [(name, "<" + array.dtype.str[1:]) for name, array in values.items()]
    row = np.dtype([("size", "u1"), ("list", "<i4", (faces.shape[1],))])
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property {names[kind[1:]]} {name}" for name, kind in columns]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header\n"]
    file.write("\n".join(lines).encode())
    for start in range(0, len(vertices), ROWS_AT_ONCE):
        part = slice(start, start + ROWS_AT_ONCE)
        rows = np.empty(len(vertices[part]), np.dtype(columns))
        for n, axis in enumerate("xyz"):
            rows[axis] = vertices[part, n]
        for name, array in values.items():
            rows[name] = array[part]
        file.write(rows.tobytes())
    for piece in _parts(faces):
        polygons = np.empty(len(piece), row)
        polygons["size"], polygons["list"] = faces.shape[1], piece
        file.write(polygons.tobytes())


def _parts(rows: NDArray[Any]) -> Iterator[NDArray[Any]]:
    for start in range(0, len(rows), ROWS_AT_ONCE):
        yield rows[start : start + ROWS_AT_ONCE]

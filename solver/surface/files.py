"""Representations as files: a zip archive of NumPy arrays (`.npz`), versioned, without pickled objects.

Reading trusts nothing.  Which arrays there are, their types and sizes are compared with the format before any of them
is read, and their contents before they are used: a cut, foreign, newer or forged file is refused in one sentence and
never evaluated.  The format is described in docs/representation.md.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import re
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..errors import FileFormatError
from ..settings import Settings
from .representation import Representation

Stored = dict[str, NDArray[Any]]

FORMAT = "sparse surface representation"
FORMAT_VERSION = 1

INDICES = ("<u2", "<i4", "<i8")
REAL = ("<f4", "<f8")

MAGIC = b"\x93NUMPY\x01\x00"
HEADER = re.compile(
    r"\{'descr': '(\S{2,4})', 'fortran_order': False, 'shape': \(((?:\d{1,12}, ?)*(?:\d{1,12})?)\), \}\s*"
)
LARGEST_HEADER = 1024
LARGEST_DEFLATION = 1040
"""No deflated file shrinks further than 1032 to 1; more is a forged size."""

LARGEST_EXPANSION, SMALL = 100, 1_000_000
"""All arrays together are at most so many times as large as the file, beyond so many bytes.  Ten times is the most that
a perfectly regular mesh comes to; more was made to fill the memory."""

LARGEST_VALUES = {
    "vertices": 1e60,
    "domains": 1e4,
    "initial_domains": 1e4,
    "weights": 2.0,
    "origins": 1e60,
    "scales": 1e60,
    "coefficients": 1e60,
}
"""Beyond these a forged file could make evaluation overflow; what is fitted stays far below."""

HARMLESS = 2e-7
"""Change of the surface, in longest sides, for which domains are rounded to single precision."""


@dataclass(frozen=True)
class Layer:
    """One array of a file: its shape in sizes that have a name, or in numbers, and the types that it may have."""

    shape: tuple[str | int, ...]
    types: tuple[str, ...]


LAYERS = {
    "vertices": Layer(("vertices", 3), REAL),
    "triangles": Layer(("triangles", 3), INDICES),
    "polygon": Layer(("triangles",), INDICES),
    "face_offsets": Layer(("faces + 1",), INDICES),
    "face_corners": Layer(("face corners",), INDICES),
    "vertex_offsets": Layer(("patches + 1",), INDICES),
    "patch_vertices": Layer(("patch vertices",), INDICES),
    "triangle_offsets": Layer(("patches + 1",), INDICES),
    "patch_triangles": Layer(("patch triangles", 3), INDICES),
    "mesh_triangles": Layer(("patch triangles",), INDICES),
    "domains": Layer(("domains", "patch vertices", 2), REAL),
    "initial_domains": Layer(("domains", "patch vertices", 2), REAL),
    "weights": Layer(("patch vertices",), REAL),
    "origins": Layer(("patches", 3), REAL),
    "scales": Layer(("patches", "domains"), REAL),
    "support": Layer(("patches", 3, "functions"), ("<i2",)),
    "coefficients": Layer(("patches", 3, "functions"), REAL),
    "energy": Layer(("patches", "iterations"), REAL),
}
"""The arrays of a file, with the names of the fields of `Representation`."""

HEAD = "head"
"""The one further array: JSON text as bytes, with format, version, and what is no array."""

HEAD_KEYS = {"format", "version", "blending", "basis", "degree"}


# Writing


def save(representation: Representation, path: str | os.PathLike[str]) -> None:
    """Write a representation to a file, which appears when it is complete.

    Raises
    ------
    OSError
        When the file cannot be written.
    """
    with _draft_beside(Path(path)) as draft:
        draft.write_bytes(representation.stored)


def compact(representation: Representation) -> Stored:
    """Return the arrays as they are stored: small types, with the surface the same to 1e-6 of its longest side."""
    arrays: Stored = {}
    for name, layer in LAYERS.items():
        array = getattr(representation, name)
        if layer.types == INDICES:
            array = array.astype(_index_type(array))
        arrays[name] = np.ascontiguousarray(array)
    arrays["support"] = arrays["support"].astype("<i2")
    for name in ("initial_domains", "energy"):  # nothing is evaluated with them
        arrays[name] = arrays[name].astype("<f4")
    if _is_single(representation.vertices):
        arrays["vertices"] = arrays["vertices"].astype("<f4")
    rounded = representation.domains.astype("<f4")
    if _change_by(representation, rounded) <= HARMLESS:
        arrays["domains"] = rounded
    return {name: array.astype(array.dtype.newbyteorder("<"), copy=False) for name, array in arrays.items()}


def to_bytes(representation: Representation) -> bytes:
    """Return a representation as the content of a file; the same for the same representation."""
    head = {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "blending": representation.blending,
        "basis": representation.basis,
        "degree": representation.degree,
    }
    text = np.frombuffer(json.dumps(head).encode("ascii"), dtype=np.uint8)
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, array in {HEAD: text, **compact(representation)}.items():
            # Date and system of origin would make files differ that hold the same.
            entry = zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type, entry.create_system = zipfile.ZIP_DEFLATED, 3
            entry.external_attr = 0o644 << 16
            content = io.BytesIO()
            np.save(content, array, allow_pickle=False)
            archive.writestr(entry, content.getvalue(), compresslevel=1)  # 9 makes 2 % less of it, in 3 times the time
    return file.getvalue()


def _index_type(indices: Indices) -> str:
    largest = int(indices.max(initial=0))
    return next(kind for kind in INDICES if largest <= np.iinfo(kind).max)


def _is_single(values: Array) -> bool:
    """Whether the values came from single precision."""
    with np.errstate(over="ignore"):
        return bool((values.astype(np.float32) == values).all())


def _change_by(representation: Representation, rounded: NDArray[np.float32]) -> float:
    """Largest move of a patch's surface when its domains are rounded, in longest sides."""
    moved = replace(representation, domains=rounded.astype(np.float64)).at_patch_vertices
    moved = moved - representation.at_patch_vertices
    size = float(np.ptp(representation.vertices, axis=0).max())
    return float(np.abs(moved).max(initial=0.0)) / size


@contextlib.contextmanager
def _draft_beside(path: Path) -> Iterator[Path]:
    """Yield a place beside `path`; what is written there takes the place of `path` when the block ends well."""
    with tempfile.TemporaryDirectory(prefix=f".{path.stem}_", dir=path.absolute().parent) as folder:
        draft = Path(folder) / path.name
        yield draft
        os.replace(draft, path)


# Reading


def load(path: str | os.PathLike[str]) -> Representation:
    """Read a representation.

    Raises
    ------
    FileFormatError
        When the file is cut, damaged, newer than this version, or something else; in one sentence.
    OSError
        When there is no such file, or it cannot be read.
    """
    with open(path, "rb") as file:
        return _read(file, f"'{Path(path).name}'")


def from_bytes(data: bytes, name: str = "The stored representation") -> Representation:
    """Read what `to_bytes` returned; `name` begins the sentence in which damaged bytes are refused."""
    return _read(io.BytesIO(data), name)


_DAMAGE = (zipfile.BadZipFile, zlib.error, EOFError, ValueError, KeyError, IndexError, OverflowError, RuntimeError)
"""What reading a damaged zip archive can raise."""


def _read(file: IO[bytes], name: str) -> Representation:
    begins_as_zip = file.read(4) == b"PK\x03\x04"
    try:
        archive = zipfile.ZipFile(file)
    except _DAMAGE:
        if begins_as_zip:
            raise FileFormatError(f"{name} is cut or damaged: its end is missing.") from None
        raise FileFormatError(f"{name} is not a saved representation of Sparse Surface.") from None
    try:
        with archive:
            head = _read_head(archive, name)
            return _checked(head, _read_layers(archive))
    except FileFormatError:
        raise
    except _Refusal as refusal:
        raise FileFormatError(f"{name} is damaged: {refusal}.") from None
    except _DAMAGE as error:
        raise FileFormatError(f"{name} is damaged: {' '.join(str(error).split()) or 'it is cut'}.") from None


class _Refusal(Exception):
    """What is wrong with a file, as the end of a sentence."""


def _demand(holds: object, otherwise: str) -> None:
    if not holds:
        raise _Refusal(otherwise)


def _read_head(archive: zipfile.ZipFile, name: str) -> dict[str, Any]:
    """Tell whether this is a representation that this version can read."""
    foreign = FileFormatError(f"{name} is not a saved representation of Sparse Surface.")
    entries = [entry for entry in archive.infolist() if entry.filename == f"{HEAD}.npy"]
    if len(entries) != 1:
        raise foreign
    kind, shape, _ = _read_header(archive, entries[0])
    if kind.str != "|u1" or len(shape) != 1 or shape[0] > LARGEST_HEADER:
        raise foreign
    head = json.loads(_read_array(archive, entries[0]).tobytes().decode("ascii"))
    if not isinstance(head, dict) or head.get("format") != FORMAT:
        raise foreign
    version = head.get("version")
    if isinstance(version, int) and version > FORMAT_VERSION:
        raise FileFormatError(
            f"{name} was written by a newer version of Sparse Surface "
            f"(format {version}, this version reads up to {FORMAT_VERSION})."
        )
    _demand(version == FORMAT_VERSION and set(head) == HEAD_KEYS, "its head is not that of this format")
    return head


def _read_layers(archive: zipfile.ZipFile) -> Stored:
    """Compare the sizes of all arrays with the format and with each other, then read them."""
    entries = {entry.filename: entry for entry in archive.infolist()}
    _demand(len(entries) == len(archive.infolist()), "it holds an array twice")
    wanted = {f"{name}.npy" for name in LAYERS}
    missing = sorted(wanted - set(entries))
    _demand(not missing, f"it lacks {missing[0] if missing else ''}")
    extra = sorted(set(entries) - wanted - {f"{HEAD}.npy"})
    _demand(not extra, f"it holds {extra[0][:40]!r}, which does not belong there" if extra else "")
    sizes: dict[str, int] = {}
    for name, layer in LAYERS.items():
        kind, shape, _ = _read_header(archive, entries[f"{name}.npy"])
        _demand(kind.str in layer.types, f"{name} has the type {kind.str}")
        _demand(len(shape) == len(layer.shape), f"{name} has {len(shape)} dimensions")
        for size, expected in zip(shape, layer.shape, strict=True):
            known = expected if isinstance(expected, int) else sizes.setdefault(expected, size)
            _demand(size == known, f"{name} has a size of {size} where {known} is expected")
    expanded = sum(entry.file_size for entry in entries.values())
    packed = sum(entry.compress_size for entry in entries.values())
    _demand(expanded <= SMALL + LARGEST_EXPANSION * packed, "it would fill the memory with repetitions")
    _demand(sizes["patches + 1"] == sizes["patches"] + 1, "the numbers of patches differ")
    _demand(sizes["domains"] in (1, 3), f"it has {sizes['domains']} domains for each patch")
    return {name: _read_array(archive, entries[f"{name}.npy"]) for name in LAYERS}


def _read_header(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> tuple[np.dtype[Any], tuple[int, ...], int]:
    """Return type, shape and header length of an array, when they agree with the size that the archive states."""
    _demand(entry.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED), "it is compressed in a foreign way")
    _demand(not entry.flag_bits & 0x1, "it is encrypted")
    _demand(entry.file_size <= LARGEST_DEFLATION * (entry.compress_size + 1), "a size in it is forged")
    with archive.open(entry) as stream:
        start = stream.read(len(MAGIC) + 2)
        length = int.from_bytes(start[len(MAGIC) :], "little")
        _demand(start[: len(MAGIC)] == MAGIC and length <= LARGEST_HEADER, f"{entry.filename[:40]!r} is no array")
        match = HEADER.fullmatch(stream.read(length).decode("latin-1"))
    if match is None:
        raise _Refusal(f"{entry.filename[:40]!r} is no plain array")
    kind = np.dtype(match[1]) if match[1] in {"|u1", "<i2", *INDICES, *REAL} else np.dtype("V1")
    shape = tuple(int(size) for size in match[2].replace(" ", "").split(",") if size)
    begins = len(start) + length
    _demand(entry.file_size == begins + math.prod(shape) * kind.itemsize, f"{entry.filename[:40]!r} has a wrong size")
    return kind, shape, begins


def _read_array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    kind, shape, begins = _read_header(archive, entry)
    with archive.open(entry) as stream:
        data = stream.read()  # grows with what is really there; the archive's checksum is compared at its end
    _demand(len(data) == entry.file_size, f"{entry.filename!r} is cut")
    return np.frombuffer(data, dtype=kind, offset=begins).reshape(shape)


# Checking


def _checked(head: dict[str, Any], stored: Stored) -> Representation:
    """Build the representation when all of its contents make sense together."""
    choices = Settings.__dataclass_fields__
    _demand(head["blending"] in ("partition", "uniform"), "its blending is unknown")
    _demand(head["basis"] in ("legendre", "monomial"), "its basis is unknown")
    degree, most = head["degree"], choices["degree"].metadata["high"]
    _demand(type(degree) is int and 0 <= degree <= most, f"its degree is not a whole number from 0 to {most}")
    arrays = {name: _widened(array, LAYERS[name]) for name, array in stored.items()}
    result = Representation(blending=head["blending"], basis=head["basis"], degree=degree, **arrays)
    _check_mesh(result)
    _check_patches(result)
    _check_functions(result)
    return result


def _widened(array: NDArray[Any], layer: Layer) -> NDArray[Any]:
    return array.astype(np.float64 if layer.types == REAL else np.int64)


def _check_mesh(result: Representation) -> None:
    _check_offsets("face_offsets", result.face_offsets, len(result.face_corners))
    _check_range("face_corners", result.face_corners, len(result.vertices))
    _check_range("triangles", result.triangles, len(result.vertices))
    _check_range("polygon", result.polygon, len(result.face_offsets) - 1)


def _check_patches(result: Representation) -> None:
    _check_offsets("vertex_offsets", result.vertex_offsets, len(result.patch_vertices))
    _check_offsets("triangle_offsets", result.triangle_offsets, len(result.patch_triangles))
    _check_range("patch_vertices", result.patch_vertices, len(result.vertices))
    _check_range("mesh_triangles", result.mesh_triangles, len(result.triangles))
    sizes = np.repeat(np.diff(result.vertex_offsets), np.diff(result.triangle_offsets))
    _demand((result.patch_triangles < sizes[:, None]).all(), "a patch's triangle names a vertex that it does not have")
    own = result.patch_vertices[result.corners]
    _demand((own == result.triangles[result.mesh_triangles]).all(), "a patch's triangle is not that of the mesh")
    twice = np.unique(result.patch_of_triangle * max(len(result.triangles), 1) + result.mesh_triangles)
    _demand(len(twice) == len(result.mesh_triangles), "a patch holds a triangle twice")


def _check_functions(result: Representation) -> None:
    for name, largest in LARGEST_VALUES.items():
        _demand((np.abs(getattr(result, name)) <= largest).all(), f"a value of {name} is too large or not finite")
    _demand((result.weights >= 0.0).all(), "a weight is negative")
    _demand((result.scales >= 1.0 / LARGEST_VALUES["scales"]).all(), "a scale is too small")
    _demand(not np.isinf(result.energy).any(), "an energy is infinite")
    functions = result.dictionary.size
    _demand((result.support >= -1).all() and (result.support < functions).all(), "a function is not in its dictionary")


def _check_offsets(name: str, offsets: Indices, end: int) -> None:
    _demand(len(offsets) > 0 and offsets[0] == 0 and offsets[-1] == end, f"{name} does not span its array")
    _demand((np.diff(offsets) >= 0).all(), f"{name} does not ascend")


def _check_range(name: str, indices: Indices, end: int) -> None:
    # 64-bit unsigned numbers cannot occur, so nothing below is a wrapped one
    _demand(indices.min(initial=0) >= 0 and indices.max(initial=-1) < end, f"{name} names what is not there")

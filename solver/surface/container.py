"""Named arrays as one file: a zip archive of NumPy arrays (`.npz`) with a head, versioned, without pickled objects.

Reading trusts nothing: the names, types and sizes of the arrays are compared with the format before any of them is
read, so that a forged file can neither run code nor fill the memory.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import re
import zipfile
import zlib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError

Arrays = dict[str, NDArray[Any]]

INDICES = ("<u2", "<i4", "<i8")
REAL = ("<f4", "<f8")

MAGIC = b"\x93NUMPY\x01\x00"
HEADER = re.compile(
    r"\{'descr': '(\S{2,4})', 'fortran_order': False, 'shape': \(((?:\d{1,12}, ?)*(?:\d{1,12})?)\), \}\s*"
)
LARGEST_HEADER = 1024
LARGEST_DEFLATION = 1040
"""No deflated file shrinks by more than 1032 to 1; a larger ratio is a forged size."""

LARGEST_EXPANSION, SMALL = 100, 1_000_000
"""Beyond `SMALL` bytes all arrays together are at most this many times as large as the file.  A perfectly regular mesh
reaches ten times; a larger ratio was made to fill the memory."""

HEAD = "head"
"""The one further array: JSON text as bytes, with the format, its version, and everything that is not an array."""

_DAMAGE = (zipfile.BadZipFile, zlib.error, EOFError, ValueError, KeyError, IndexError, OverflowError, RuntimeError)
"""What reading a damaged zip archive can raise."""


@dataclass(frozen=True)
class Layer:
    """One array of a file: its shape in named sizes or numbers, and the types that it may have."""

    shape: tuple[str | int, ...]
    types: tuple[str, ...]


@dataclass(frozen=True)
class Format:
    """A kind of file.

    Attributes
    ----------
    name, version
        What its head says.
    noun
        What a file of this kind is called in messages.
    keys
        What else the head holds.
    layers
        The arrays by name.
    """

    name: str
    version: int
    noun: str
    keys: frozenset[str]
    layers: Mapping[str, Layer]


class Refusal(Exception):
    """What is wrong with a file, as the end of a sentence."""


def demand(holds: object, otherwise: str) -> None:
    """Refuse the file unless the condition holds."""
    if not holds:
        raise Refusal(otherwise)


@contextlib.contextmanager
def refusing(name: str) -> Iterator[None]:
    """Turn whatever is wrong with a file into a `FileFormatError` of one sentence, which `name` begins."""
    try:
        yield
    except FileFormatError:
        raise
    except Refusal as refusal:
        raise FileFormatError(f"{name} is damaged: {refusal}.") from None
    except _DAMAGE as error:
        raise FileFormatError(f"{name} is damaged: {' '.join(str(error).split()) or 'it is cut'}.") from None


def pack(kind: Format, head: Mapping[str, Any], arrays: Arrays) -> bytes:
    """Return a head and arrays as the content of a file; the same bytes for the same arrays.

    Arrays of bytes are taken to be compressed.
    """
    text = json.dumps({"format": kind.name, "version": kind.version, **head}).encode("ascii")
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, array in {HEAD: np.frombuffer(text, dtype=np.uint8), **arrays}.items():
            # Date and system of origin would make files differ that hold the same.
            entry = zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0))
            packed = name != HEAD and array.dtype == np.uint8
            entry.compress_type, entry.create_system = zipfile.ZIP_STORED if packed else zipfile.ZIP_DEFLATED, 3
            entry.external_attr = 0o644 << 16
            content = io.BytesIO()
            np.save(content, array, allow_pickle=False)
            archive.writestr(entry, content.getvalue(), compresslevel=1)  # 9 makes 2 % less of it, in 3 times the time
    return file.getvalue()


def unpack(
    kinds: Mapping[int, Format], file: IO[bytes], name: str, only: Collection[str] | None = None
) -> tuple[int, dict[str, Any], Arrays, dict[str, int]]:
    """Read a file that `pack` made, of one of several versions; where names are given, only these arrays.

    Returns
    -------
    version, head, arrays, sizes
        The version, the further contents of the head, the arrays as stored, and the sizes that the layers' shapes name.

    Raises
    ------
    FileFormatError
        When the file is cut, damaged, newer than this version, or something else; `name` begins the sentence.
    """
    begins_as_zip = file.read(4) == b"PK\x03\x04"
    try:
        archive = zipfile.ZipFile(file)
    except _DAMAGE:
        if begins_as_zip:
            raise FileFormatError(f"{name} is cut or damaged: its end is missing.") from None
        raise FileFormatError(f"{name} is not {kinds[max(kinds)].noun}.") from None
    with refusing(name), archive:
        version, head = _read_head(kinds, archive, name)
        return version, head, *_read_layers(kinds[version], archive, only)


def _read_head(kinds: Mapping[int, Format], archive: zipfile.ZipFile, name: str) -> tuple[int, dict[str, Any]]:
    kind = kinds[max(kinds)]
    foreign = FileFormatError(f"{name} is not {kind.noun}.")
    entries = [entry for entry in archive.infolist() if entry.filename == f"{HEAD}.npy"]
    if len(entries) != 1:
        raise foreign
    type_, shape, _ = _read_header(archive, entries[0])
    if type_.str != "|u1" or len(shape) != 1 or shape[0] > LARGEST_HEADER:
        raise foreign
    head = json.loads(_read_array(archive, entries[0]).tobytes().decode("ascii"))
    if not isinstance(head, dict) or head.get("format") != kind.name:
        raise foreign
    version = head.get("version")
    if isinstance(version, int) and version > kind.version:
        raise FileFormatError(
            f"{name} was written by a newer version of Sparse Surface "
            f"(format {version}, this version reads up to {kind.version})."
        )
    own = {name: value for name, value in head.items() if name not in ("format", "version")}
    if type(version) is not int or version not in kinds:
        raise Refusal("its version is unknown")
    demand(set(own) == kinds[version].keys, "its head is not that of this format")
    return version, own


def _read_layers(kind: Format, archive: zipfile.ZipFile, only: Collection[str] | None) -> tuple[Arrays, dict[str, int]]:
    """Compare the sizes of all arrays with the format and with each other, then read them."""
    entries = {entry.filename: entry for entry in archive.infolist()}
    demand(len(entries) == len(archive.infolist()), "it holds an array twice")
    wanted = {f"{name}.npy" for name in kind.layers}
    missing = sorted(wanted - set(entries))
    demand(not missing, f"it lacks {missing[0] if missing else ''}")
    extra = sorted(set(entries) - wanted - {f"{HEAD}.npy"})
    demand(not extra, f"it holds {extra[0][:40]!r}, which does not belong there" if extra else "")
    sizes: dict[str, int] = {}
    for name, layer in kind.layers.items():
        type_, shape, _ = _read_header(archive, entries[f"{name}.npy"])
        demand(type_.str in layer.types, f"{name} has the type {type_.str}")
        demand(len(shape) == len(layer.shape), f"{name} has {len(shape)} dimensions")
        for size, expected in zip(shape, layer.shape, strict=True):
            known = expected if isinstance(expected, int) else sizes.setdefault(expected, size)
            demand(size == known, f"{name} has a size of {size} where {known} is expected")
    expanded = sum(entry.file_size for entry in entries.values())
    packed = sum(entry.compress_size for entry in entries.values())
    demand(expanded <= SMALL + LARGEST_EXPANSION * packed, "it would fill the memory with repetitions")
    names = kind.layers if only is None else only
    return {name: _read_array(archive, entries[f"{name}.npy"]) for name in names}, sizes


def _read_header(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> tuple[np.dtype[Any], tuple[int, ...], int]:
    """Return type, shape and header length of an array, when they agree with the size that the archive states."""
    demand(entry.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED), "it is compressed in a foreign way")
    demand(not entry.flag_bits & 0x1, "it is encrypted")
    demand(entry.file_size <= LARGEST_DEFLATION * (entry.compress_size + 1), "a size in it is forged")
    with archive.open(entry) as stream:
        start = stream.read(len(MAGIC) + 2)
        length = int.from_bytes(start[len(MAGIC) :], "little")
        demand(start[: len(MAGIC)] == MAGIC and length <= LARGEST_HEADER, f"{entry.filename[:40]!r} is not an array")
        match = HEADER.fullmatch(stream.read(length).decode("latin-1"))
    if match is None:
        raise Refusal(f"{entry.filename[:40]!r} is not a plain array")
    kind = np.dtype(match[1]) if match[1] in {"|u1", "<i2", *INDICES, *REAL} else np.dtype("V1")
    shape = tuple(int(size) for size in match[2].replace(" ", "").split(",") if size)
    begins = len(start) + length
    demand(entry.file_size == begins + math.prod(shape) * kind.itemsize, f"{entry.filename[:40]!r} has a wrong size")
    return kind, shape, begins


def _read_array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    kind, shape, begins = _read_header(archive, entry)
    with archive.open(entry) as stream:
        data = stream.read()  # grows with what is really there; the archive's checksum is compared at its end
    demand(len(data) == entry.file_size, f"{entry.filename!r} is cut")
    return np.frombuffer(data, dtype=kind, offset=begins).reshape(shape)

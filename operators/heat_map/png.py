"""Writes pictures as PNG files whose bytes depend on the picture only."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...solver.atomic_files import atomic_output

SIGNATURE = b"\x89PNG\r\n\x1a\n"
UP = 2
"""The filter of PNG that stores each row as its difference from the row above."""


def write_png(picture: Path, colours: NDArray[np.floating[Any]]) -> None:
    """Write sRGB values in [0, 1], (rows from the bottom, columns, 3); the file appears when it is complete."""
    with atomic_output(picture) as draft:
        draft.write_bytes(encoded(np.rint(255.0 * np.clip(colours[::-1], 0.0, 1.0)).astype(np.uint8)))


def encoded(values: NDArray[np.uint8]) -> bytes:
    """Return the PNG file of values (rows from the top, columns, 3)."""
    height, width = values.shape[:2]
    rows = values.reshape(height, -1)
    filtered = np.full((height, 1 + rows.shape[1]), UP, dtype=np.uint8)
    filtered[:, 1:] = rows
    filtered[1:, 1:] -= rows[:-1]
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)  # eight bits each of red, green and blue
    parts = ((b"IHDR", head), (b"IDAT", zlib.compress(filtered.tobytes())), (b"IEND", b""))
    return SIGNATURE + b"".join(_chunk(kind, content) for kind, content in parts)


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

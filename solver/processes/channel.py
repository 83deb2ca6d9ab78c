"""Messages between a process and its children: pickles in frames, through pipes.

A frame is the number of its parts, the length of each (8 bytes, little-endian) and the parts: the pickle, then the
contents of the arrays in it.  An array is thus written from where it lies and read to where it stays: no thread that
shares Python's lock with the reader waits while a large one is copied.

Functions and classes travel by name.  The package's name may differ on both sides (``bl_ext...`` exists only inside
Blender), so each side reads the other's names as its own.  A pickle can run any code, so none is ever read from a file:
only from a child, or from the owner that started this process.
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Sequence
from io import FileIO
from typing import Any

import numpy as np

OWN_PACKAGE = __name__.removesuffix(".processes.channel")

FINISH_MESSAGE: tuple[()] = ()
"""The frame that asks a child to end its task early with the best result so far."""

_LENGTH_BYTES = 8

Parts = Sequence[bytes | memoryview]


def pack(message: Any, *, snapshot: bool = False) -> Parts:
    """Return the parts of a message; with `snapshot` its arrays may change before it is sent.

    Raises
    ------
    pickle.PicklingError, AttributeError, TypeError
        When something in the message cannot travel.
    """
    if snapshot:
        return [pickle.dumps(message, protocol=5)]
    buffers: list[pickle.PickleBuffer] = []
    head = pickle.dumps(message, protocol=5, buffer_callback=buffers.append)
    return [head, *(buffer.raw() for buffer in buffers)]


def unpack(parts: Parts, their_package: str) -> Any:
    """Return the message of a process in which this package is called `their_package`."""
    return _Unpickler(parts, their_package).load()


def send(stream: FileIO, parts: Parts) -> None:
    """Write a frame to an unbuffered pipe."""
    lengths = [len(parts), *(len(part) for part in parts)]
    head = b"".join(length.to_bytes(_LENGTH_BYTES, "little") for length in lengths)
    for part in (head, *parts):
        rest = memoryview(part)
        while rest:
            rest = rest[stream.write(rest) :]


def receive(stream: FileIO) -> Parts:
    """Read a frame from an unbuffered pipe.

    Raises
    ------
    EOFError
        When the pipe ends before the frame does.
    """
    count = int.from_bytes(_read(stream, _LENGTH_BYTES), "little")
    lengths = [int.from_bytes(_read(stream, _LENGTH_BYTES), "little") for _ in range(count)]
    return [_read(stream, length) for length in lengths]


def _read(stream: FileIO, length: int) -> memoryview:
    data = np.empty(length, dtype=np.uint8).data  # unlike a bytearray it is not filled with zeros first
    filled = 0
    while filled < length:
        count = stream.readinto(data[filled:])
        if not count:
            raise EOFError
        filled += count
    return data


class _Unpickler(pickle.Unpickler):
    def __init__(self, parts: Parts, their_package: str) -> None:
        super().__init__(io.BytesIO(parts[0]), buffers=parts[1:])
        self._theirs = their_package

    def find_class(self, module: str, name: str) -> Any:
        if module == self._theirs or module.startswith(f"{self._theirs}."):
            module = f"{OWN_PACKAGE}{module[len(self._theirs) :]}"
        return super().find_class(module, name)

"""Files that appear when they are complete.  Needs no Blender."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOM = 1 << 16
"""Bytes that a disk must still have after writing: Blender's exporters cut a file short without a word."""


@contextlib.contextmanager
def beside(path: Path) -> Iterator[Path]:
    """Yield a place beside `path` to write to; what stands there at the end is renamed to `path`.

    The place has the same file name, in a folder of its own, because exporters write further files
    (materials, buffers) that refer to each other by name.  When the block fails nothing of it remains.

    Raises
    ------
    OSError
        When the folder cannot be written, nothing was written, or the disk is full.
    """
    folder = Path(tempfile.mkdtemp(prefix=f".{path.stem}_", dir=path.absolute().parent))
    try:
        yield folder / path.name
        written = sorted(folder.iterdir())
        if folder / path.name not in written:
            raise OSError(f"'{path}' was not written")
        _check_room(folder)
        for product in written:
            os.replace(product, path.absolute().parent / product.name)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _check_room(folder: Path) -> None:
    """Raise what writing to a full disk raises, also where what was written is too short and nobody said so."""
    with open(folder / "room", "wb") as file:
        file.write(bytes(ROOM))
        file.flush()
        os.fsync(file.fileno())
    os.unlink(folder / "room")

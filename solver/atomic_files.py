"""Files that appear when they are complete."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOM = 1 << 16
"""Bytes that must still fit on the disk after a silent writer has finished."""


@contextlib.contextmanager
def atomic_output(path: Path, *, silent_writer: bool = False) -> Iterator[Path]:
    """Yield a path to write to; when the block ends well, the file moves to `path`, and when it fails nothing remains.

    The draft has the same file name in a temporary folder beside `path`, because exporters write further files
    (materials, buffers) that refer to each other by name.

    Parameters
    ----------
    silent_writer
        Whether what writes may cut a file short on a full disk without an error, as Blender's exporters do.

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
        if silent_writer:
            _check_room(folder)
        for product in written:
            os.replace(product, path.absolute().parent / product.name)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _check_room(folder: Path) -> None:
    """Raise what writing to a full disk raises, even if the writer did not notice that its file is too short."""
    with open(folder / "room", "wb") as file:
        file.write(bytes(ROOM))
        file.flush()
        os.fsync(file.fileno())
    os.unlink(folder / "room")

"""Files that appear when they are complete.  Needs no Blender."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def beside(path: Path) -> Iterator[Path]:
    """Yield a place beside `path` to write to; what stands there at the end is renamed to `path`.

    The place has the same file name, in a folder of its own, because exporters write further files
    (materials, buffers) that refer to each other by name.  When the block fails nothing of it remains.
    """
    folder = Path(tempfile.mkdtemp(prefix=f".{path.stem}_", dir=path.absolute().parent))
    try:
        yield folder / path.name
        written = sorted(folder.iterdir())
        if folder / path.name not in written:
            raise OSError(f"'{path}' was not written")
        for product in written:
            os.replace(product, path.absolute().parent / product.name)
    finally:
        shutil.rmtree(folder, ignore_errors=True)

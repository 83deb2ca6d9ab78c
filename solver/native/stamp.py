"""The stamp that tells whether a built kernel belongs to the sources beside it."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

__all__ = ["source_stamp"]


def source_stamp(folder: Path) -> str | None:
    """Return a digest of the C files in a folder; None where there are none, as in a zip or a wheel.

    Line ends do not count: a checkout on Windows may have others.
    """
    sources = sorted(folder.glob("*.[ch]"))
    if not sources:
        return None
    digest = sha256()
    for source in sources:
        digest.update(source.name.encode() + b"\n" + source.read_bytes().replace(b"\r\n", b"\n"))
    return digest.hexdigest()[:16]

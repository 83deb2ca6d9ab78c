"""What a binary .stl says beside its triangles: a header of 80 bytes, and two bytes for each triangle.

Programs keep units and a colour of the whole in the one, and colours of triangles in the others.  Blender and meshio
read neither and write zeros.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

HEADER = 80
TRIANGLE = np.dtype([("numbers", "<f4", (12,)), ("attribute", "<u2")])


def carry_marks(source: Path | None, written: Path) -> None:
    """Give a binary .stl the header and the triangles' bytes of the one that it was made from, if both are such files.

    Triangles keep their order from file to file; where their number differs, some were left out, and nothing is taken.
    """
    if source is None or {source.suffix.lower(), written.suffix.lower()} != {".stl"}:
        return
    given, made = _triangles(source), _triangles(written)
    if given is None or made is None or len(given) != len(made):
        return
    made["attribute"] = given["attribute"]
    with open(source, "rb") as file:
        header = file.read(HEADER)
    count = np.uint32(len(made)).astype("<u4").tobytes()
    written.write_bytes((bytes(HEADER) if header.startswith(b"solid") else header) + count + made.tobytes())


def _triangles(path: Path) -> np.ndarray | None:
    """Return the triangles of a binary file; None where it is none."""
    content = path.read_bytes()
    count = int(np.frombuffer(content[HEADER : HEADER + 4], "<u4")[0]) if len(content) >= HEADER + 4 else -1
    if len(content) != HEADER + 4 + count * TRIANGLE.itemsize:
        return None
    return np.frombuffer(content, TRIANGLE, offset=HEADER + 4).copy()

"""Files whose coordinates were shifted to the origin: the shift is given back in double precision.

Blender holds coordinates in single precision, so a mesh far from the origin is written near it and moved in the file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

NUMBERS = {
    "char": "i1",
    "uchar": "u1",
    "short": "<i2",
    "ushort": "<u2",
    "int": "<i4",
    "uint": "<u4",
    "float": "<f4",
    "double": "<f8",
}
"""Types of properties in a .ply file."""


def _shift_obj(path: Path, shift: NDArray[np.float64]) -> None:
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    for number, line in enumerate(lines):
        if line.startswith("v "):
            words = line.split()
            moved = np.array(words[1:4], dtype=np.float64) + shift
            lines[number] = " ".join(["v", *(f"{value:.6f}" for value in moved), *words[4:]]) + "\n"
    path.write_text("".join(lines), encoding="utf-8")


def _shift_ply(path: Path, shift: NDArray[np.float64]) -> None:
    """Make the coordinates of a binary .ply file, as Blender writes it, double and move them."""
    content = path.read_bytes()
    head, mark, body = content.partition(b"end_header\n")
    lines = head.decode("ascii").splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("element vertex"))
    count, fields, last = int(lines[first].split()[2]), [], first + 1
    while last < len(lines) and lines[last].startswith("property "):
        _, kind, name = lines[last].split()
        fields.append((name, NUMBERS[kind]))
        if name in "xyz":
            lines[last] = f"property double {name}"
        last += 1
    before = np.dtype(fields)
    table = np.frombuffer(body, dtype=before, count=count)
    moved = np.empty(count, dtype=np.dtype([(name, "<f8" if name in "xyz" else kind) for name, kind in fields]))
    for name, _ in fields:
        moved[name] = table[name]
    for axis, distance in zip("xyz", shift, strict=True):
        moved[axis] += distance
    rest = body[count * before.itemsize :]
    path.write_bytes("\n".join(lines).encode("ascii") + b"\n" + mark + moved.tobytes() + rest)


SHIFTERS = {".obj": _shift_obj, ".ply": _shift_ply}
"""What moves the coordinates of a file, by its ending; other formats hold single precision only."""


def give_back_shift(path: Path, ending: str, shift: NDArray[np.float64]) -> bool:
    """Move a file that Blender wrote by this shift, (3,); returns whether its kind holds double precision."""
    move = SHIFTERS.get(ending)
    if move is None:
        return False
    move(path, shift)
    return True

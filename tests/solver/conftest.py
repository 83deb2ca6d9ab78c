"""What the solver's tests share."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

Model = tuple[NDArray[np.float64], NDArray[np.int64]]


def read_obj(path: Path) -> Model:
    lines = [line.split() for line in path.read_text().splitlines()]
    vertices = [[float(part) for part in line[1:4]] for line in lines if line[:1] == ["v"]]
    faces = [[int(part.partition("/")[0]) - 1 for part in line[1:]] for line in lines if line[:1] == ["f"]]
    return np.array(vertices), np.array(faces)


def read_ply(path: Path) -> Model:
    """Read a binary little-endian triangle mesh whose vertices have only coordinates."""
    header, _, body = path.read_bytes().partition(b"end_header\n")
    counts = {line.split()[1]: int(line.split()[2]) for line in header.decode().splitlines() if "element" in line}
    vertices = np.frombuffer(body, dtype="<f4", count=3 * counts["vertex"]).reshape(-1, 3)
    row = np.dtype([("size", "u1"), ("corners", "<i4", 3)])
    faces = np.frombuffer(body, dtype=row, count=counts["face"], offset=vertices.nbytes)
    return vertices.astype(np.float64), faces["corners"].astype(np.int64)


@pytest.fixture(scope="session")
def load_model(shared_model: Callable[[str], Path]) -> Callable[[str], Model]:
    """Return a function that reads a downloaded model, and skips the test where there is none."""

    def load(name: str) -> Model:
        path = shared_model(name)
        return read_ply(path) if path.suffix == ".ply" else read_obj(path)

    return load


@pytest.fixture
def living_children() -> Callable[[], set[int]]:
    """Return a function that gives the process numbers of this process's living children."""
    if not Path("/proc/self/stat").exists():
        pytest.skip("looks at processes through /proc")
    return lambda: {int(stat.parent.name) for stat in Path("/proc").glob("[0-9]*/stat") if _is_own_child(stat)}


def _is_own_child(stat: Path) -> bool:
    try:
        state, parent = stat.read_text().rpartition(")")[2].split()[:2]
    except OSError:  # it has just ended
        return False
    return int(parent) == os.getpid() and state != "Z"

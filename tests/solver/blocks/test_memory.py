"""What the calling process keeps of a mesh in blocks."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import Settings
from sparse_surface.solver.blocks.approximate_blocks import _welded
from sparse_surface.solver.blocks.cut import Cut, Parts
from sparse_surface.solver.blocks.large_mesh import LargeMesh
from sparse_surface.solver.blocks.scratch import Scratch

BYTES_A_VERTEX = 60


def largest(count: int, folder: Path) -> int:
    """Bytes that cutting a terrain takes at most, beside the terrain and files."""
    vertices, faces = models.creased_terrain(count)
    vertices, faces = vertices.astype(np.float32), faces.astype(np.int32)
    tracemalloc.start()
    try:
        with Scratch(folder / "scratch") as scratch:
            given = LargeMesh.of(vertices, faces)
            mesh, welded = _welded(given, vertices, faces, Settings())
            assert welded is None
            mesh.fingerprint()
            cut = Cut.of(mesh, 10_000)
            parts = Parts(mesh, cut, 16, scratch.array)
            for number in (0, len(cut) - 1):
                parts.task(number, parts.part(number), Settings(), 7)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_cutting_takes_few_bytes_a_vertex(tmp_path) -> None:
    few, many = largest(90_000, tmp_path), largest(360_000, tmp_path)
    assert few < many < few + BYTES_A_VERTEX * 270_000
    assert not (tmp_path / "scratch").exists()


def test_scratch_holds_zeros_and_what_is_written(tmp_path) -> None:
    (tmp_path / "scratch").mkdir()
    (tmp_path / "scratch" / "left").write_bytes(b"of a killed process")
    with Scratch(tmp_path / "scratch") as scratch:
        assert not any((tmp_path / "scratch").iterdir())
        one, none = scratch.array("one", (1000, 3), np.float64), scratch.array("none", (0, 3), np.int32)
        assert not one.any()
        assert none.shape == (0, 3)
        one[::2] = np.arange(3)
        scratch.rest()
        assert (one[::2] == np.arange(3)).all()
        assert not one[1::2].any()
    assert not (tmp_path / "scratch").exists()
    with pytest.raises(KeyboardInterrupt), Scratch(tmp_path / "scratch"):
        raise KeyboardInterrupt
    assert not (tmp_path / "scratch").exists()

"""Block surfaces evaluated and resampled from their files: as in one piece, closed, and without reading everything."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import InputError, Settings, approximate, approximate_blocks, resample
from sparse_surface.solver.blocks import resampled
from sparse_surface.solver.blocks.folder import JobFolder

FAST = Settings(ring=4, degree=7, sparsity=8, iterations=2, sweeps=0, workers=1)


@pytest.fixture(autouse=True)
def small_pieces(monkeypatch) -> None:
    """So that blocks are written in many pieces."""
    monkeypatch.setattr(resampled, "POINTS_AT_ONCE", 2000)


def in_order(points):
    return points[np.lexsort(np.round(points, 9).T)]


@pytest.mark.parametrize("model", [models.creased_terrain(1500), models.cube(8)], ids=["triangles", "quads"])
def test_one_block_is_resampled_as_in_one_piece(model) -> None:
    whole = resample(approximate(*model, FAST).representation, 3)
    found = approximate_blocks(*model, FAST).representation.resample(3)
    np.testing.assert_array_equal(in_order(found.vertices), in_order(whole.vertices))
    corners = [mesh.vertices[mesh.corners].reshape(len(whole.sizes), -1) for mesh in (found, whole)]
    np.testing.assert_array_equal(*map(in_order, corners))
    assert (found.sizes == whole.sizes[0]).all()


def test_pentagons_become_triangles_and_stay_whole_where_nothing_is_split() -> None:
    vertices, faces = pentagons()
    made = approximate_blocks(vertices, faces, FAST)
    whole = resample(approximate(vertices, faces, FAST).representation, 2)
    assert sorted(made.representation.resample(1).sizes) == sorted(map(len, faces))
    found = made.representation.resample(2)
    np.testing.assert_array_equal(in_order(found.vertices), in_order(whole.vertices))
    assert sorted(found.sizes) == sorted(whole.sizes)


def pentagons():
    """Two pentagons side by side, a triangle and a quad."""
    vertices = np.array(
        [[0, 0, 0], [2, 0, 0], [2, 1, 0], [1, 2, 0.5], [0, 1, 0], [4, 0, 0], [4, 1, 0], [3, 2, 0.5], [2, 3, 0.0]]
    )
    return vertices, [[0, 1, 2, 3, 4], [1, 5, 6, 7, 2], [2, 7, 3], [3, 7, 8]]


@pytest.mark.parametrize("splits", [1, 2, 5])
def test_blocks_make_one_closed_mesh(splits) -> None:
    vertices, quads = models.cube(10)
    made = approximate_blocks(vertices, quads, FAST, block_size=150)
    assert made.report["input"]["blocks"] == 5
    found = made.representation.resample(splits)
    faces = found.faces
    sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, uses = np.unique(sides, axis=0, return_counts=True)
    assert (uses == 2).all()
    assert len(faces) == len(quads) * splits**2
    assert len(np.unique(faces)) == len(found.vertices) == len(edges) - len(faces) + 2  # Euler
    assert (found.vertices[: len(vertices)] == made.vertices).all()
    if splits == 1:
        assert sorted(map(tuple, faces.tolist())) == sorted(map(tuple, quads.tolist()))
    assert np.abs(np.abs(found.vertices).max(axis=1) - np.abs(vertices).max()).max() < 0.05


def test_only_the_blocks_that_count_are_read(terrain, monkeypatch) -> None:
    made = approximate_blocks(*terrain, FAST, block_size=500)
    assert made.report["input"]["blocks"] > 5
    points = made.representation.evaluate(np.arange(len(terrain[1])), np.tile([0.2, 0.3, 0.5], (len(terrain[1]), 1)))
    read: list[int] = []
    usual = JobFolder.block
    monkeypatch.setattr(JobFolder, "block", lambda self, number: read.append(number) or usual(self, number))
    made.representation._held.clear()
    corner = np.argmin(terrain[0][terrain[1]].sum(axis=(1, 2)))
    one = made.representation.evaluate([corner], [[0.2, 0.3, 0.5]])
    assert (one[0] == points[corner]).all()
    assert 1 <= len(read) < made.report["input"]["blocks"] / 2


def test_what_cannot_be_resampled_is_one_sentence(terrain) -> None:
    surface = approximate_blocks(*terrain, FAST).representation
    for splits, said in ((0, "1 part or more"), (1.5, "whole number"), (10**5, "fewer parts")):
        with pytest.raises(InputError, match=said):
            surface.resample(splits)

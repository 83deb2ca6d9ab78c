"""Creases that blocks mark, and noise that they remove: as in one piece."""

from __future__ import annotations

import numpy as np
import pytest
from noisy import with_noise
from numpy.typing import NDArray
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import Settings, approximate, approximate_blocks

FAST = {"ring": 4, "degree": 7, "sparsity": 8, "iterations": 3, "workers": 1}


def edges_of(faces: NDArray[np.int64]) -> set[tuple[int, int]]:
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    return set(map(tuple, np.sort(sides, axis=1).tolist()))


def rms(points: NDArray[np.floating], others: NDArray[np.floating]) -> float:
    return float(np.sqrt(((points.astype(np.float64) - others) ** 2).sum(axis=1).mean()))


def test_creases_are_those_of_one_piece(terrain, tmp_path) -> None:
    settings = Settings(**FAST, mark_creases=True)
    blocks = approximate_blocks(*terrain, settings, block_size=800, folder=tmp_path / "job")
    found = set(map(tuple, np.asarray(blocks.creases).tolist()))
    whole = set(map(tuple, np.sort(approximate(*terrain, settings).creases, axis=1).tolist()))
    assert len(whole) > 50
    # the covers differ, and so do the folds that few iterations show
    assert len(found & whole) > 0.75 * len(found | whole)
    assert found <= edges_of(terrain[1])
    again = approximate_blocks(*terrain, settings, block_size=800, folder=tmp_path / "job")
    np.testing.assert_array_equal(again.creases, blocks.creases)
    assert approximate_blocks(*terrain, Settings(**FAST), block_size=800).creases is None


def test_creases_lie_between_the_given_vertices() -> None:
    """Where vertices at one place are held together, creases still name those that were given."""
    vertices, faces = models.cube(10)
    apart = vertices[faces].reshape(-1, 3)
    own = np.arange(len(apart)).reshape(faces.shape)
    found = approximate_blocks(apart, own, Settings(**FAST, mark_creases=True), block_size=300)
    assert set(map(tuple, np.asarray(found.creases).tolist())) <= edges_of(own)
    ends = apart[found.creases]
    limits = np.stack([vertices.min(axis=0), vertices.max(axis=0)])
    on_edge = (np.abs(ends.mean(axis=1)[:, None] - limits).min(axis=1) < 1e-6).sum(axis=1) >= 2
    assert on_edge.mean() > 0.9
    assert len(on_edge) > 100


@pytest.fixture(scope="module")
def noisy():
    vertices, faces = models.creased_terrain(3000)
    return vertices, with_noise(vertices, faces, 0.002, 3), faces


def test_noise_is_removed_as_in_one_piece(noisy, tmp_path) -> None:
    clean, given, faces = noisy
    settings = Settings(**FAST, denoise="only")
    whole = approximate(given, faces, settings)
    blocks = approximate_blocks(given, faces, settings, block_size=800, folder=tmp_path / "job")
    assert rms(whole.vertices, clean) < 0.7 * rms(given, clean)
    assert rms(blocks.vertices, clean) < 1.1 * rms(whole.vertices, clean)
    levels = [result.report["denoise"]["noise_level"] for result in (blocks, whole)]
    assert levels[0] == pytest.approx(levels[1], rel=0.3)
    inside = np.tile([0.2, 0.3, 0.5], (len(faces), 1))
    points = blocks.representation.evaluate(np.arange(len(faces)), inside)
    flat = np.einsum("k,tkd->td", [0.2, 0.3, 0.5], np.asarray(blocks.vertices)[faces])
    # where blocks overlap, their denoised meshes differ a little
    assert np.abs(points - flat).max() < 0.2 * levels[0]
    assert np.median(np.abs(points - flat)) < 1e-9
    two = approximate_blocks(given, faces, Settings(**{**FAST, "workers": 2}, denoise="only"), block_size=800)
    assert np.asarray(two.vertices).tobytes() == np.asarray(blocks.vertices).tobytes()


def test_what_is_without_noise_is_approximated(noisy) -> None:
    clean, given, faces = noisy
    settings = Settings(**FAST, denoise="first")
    whole = approximate(given, faces, settings)
    blocks = approximate_blocks(given, faces, settings, block_size=800)
    assert rms(blocks.vertices, clean) < 1.1 * rms(whole.vertices, clean) < 0.8 * rms(given, clean)
    assert blocks.report["denoise"]["fit"]["surface_error"]["rms"] < 1.2 * rms(whole.vertices, clean)
    assert blocks.report["patches"] > 50


def test_a_mesh_without_noise_comes_back(noisy) -> None:
    clean, _, faces = noisy
    found = approximate_blocks(clean, faces, Settings(**FAST, denoise="only"), block_size=800)
    assert np.asarray(found.vertices).tobytes() == clean.tobytes()

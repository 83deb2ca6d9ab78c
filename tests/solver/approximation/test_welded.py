"""Meshes whose vertices are there several times: closed stays closed, and every vertex comes back."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.solver import FINISH, Settings, approximate, approximate_steps, denoise, resample, run_to_end

QUICK = {"iterations": 3, "sweeps": 0, "workers": 1}


def ball(size: int = 9) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and quads of a closed, cube-like ball."""
    axis = np.linspace(-1.0, 1.0, size)
    x, y = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
    i = np.arange(size * size).reshape(size, size)
    quad = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=2).reshape(-1, 4)
    points, faces = [], []
    for axis_number in range(3):
        for sign in (-1.0, 1.0):
            columns = np.stack([np.full_like(x, sign), x, sign * y], axis=1)
            faces.append(quad + len(points) * len(x))
            points.append(np.roll(columns, axis_number, axis=1))
    unique, inverse = np.unique(np.concatenate(points).round(9), axis=0, return_inverse=True)
    return unique / np.linalg.norm(unique, ord=4, axis=1)[:, None], inverse.reshape(-1)[np.concatenate(faces)]


def halves(points: np.ndarray, faces: np.ndarray, away: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces with a seam of doubled vertices around the middle, the copies moved by `away` and less."""
    upper = points[faces].mean(axis=1)[:, 2] > 0.0
    shared = np.intersect1d(faces[upper], faces[~upper])
    copy = np.arange(len(points))
    copy[shared] = len(points) + np.arange(len(shared))
    moved = points[shared] + away * np.random.default_rng(1).uniform(-0.5, 0.5, (len(shared), 3))
    return np.concatenate([points, moved]), np.where(upper[:, None], copy[faces], faces)


def open_edges(points: np.ndarray, faces: np.ndarray) -> int:
    """Edges of one face only, vertices with equal coordinates being one."""
    _, place = np.unique(points, axis=0, return_inverse=True)
    corners = place.reshape(-1)[faces]
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    _, count = np.unique(np.sort(ends, axis=1), axis=0, return_counts=True)
    return int((count == 1).sum())


def split(kind: str) -> tuple[np.ndarray, np.ndarray]:
    points, faces = ball()
    if kind == "soup":
        return points[faces].reshape(-1, 3), np.arange(faces.size).reshape(faces.shape)
    if kind == "each face of the cube":
        part = np.repeat(np.arange(6), len(faces) // 6)
        pairs, corner = np.unique(np.stack([np.repeat(part, 4), faces.ravel()], axis=1), axis=0, return_inverse=True)
        return points[pairs[:, 1]], corner.reshape(faces.shape)
    return halves(points, faces, {"exact": 0.0, "last digits": 8e-7}[kind])


@pytest.mark.parametrize("kind", ["exact", "last digits", "soup", "each face of the cube"])
@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_a_closed_mesh_stays_closed_whatever_its_split(kind: str, precision: type) -> None:
    points, faces = split(kind)
    points = points.astype(precision)
    result = approximate(points, faces, Settings(**QUICK))
    assert result.vertices.shape == points.shape
    assert result.vertices.dtype == precision
    assert open_edges(result.vertices, faces) == 0
    assert result.report["input"]["merged_vertices"] == len(points) - len(ball()[0])
    assert result.report["input"]["components"] == 1
    assert result.report["input"]["vertices"] == len(points) == len(result.error) == len(result.patch)
    away = np.linalg.norm(result.vertices.astype(float) - points, axis=1)
    assert np.allclose(result.error, away, atol=1e-7)
    assert result.report["vertex_error"]["max"] == pytest.approx(away.max(), abs=1e-7)
    assert result.report["surface_error"]["bound"] >= away.max() - 1e-7
    whole = approximate(ball()[0].astype(precision), ball()[1], Settings(**QUICK))
    assert result.report["patches"] == pytest.approx(whole.report["patches"], abs=3)


def test_without_merging_the_seam_opens() -> None:
    points, faces = split("last digits")
    result = approximate(points, faces, Settings(**QUICK, merge_vertices=False))
    assert open_edges(result.vertices, faces) > 0
    assert "merged_vertices" not in result.report["input"]


def test_a_wider_seam_is_closed_by_a_distance() -> None:
    points, faces = halves(*ball(), away=1e-3)
    assert open_edges(approximate(points, faces, Settings(**QUICK)).vertices, faces) > 0
    result = approximate(points, faces, Settings(**QUICK, merge_distance=2e-3))
    assert open_edges(result.vertices, faces) == 0
    assert result.report["surface_error"]["bound"] >= result.error.max()


def test_weights_previews_histories_and_resampling_fit_the_given_vertices() -> None:
    points, faces = split("each face of the cube")
    weights = np.where(points[:, 2] > 0.9, 0.0, 1.0)
    weights[0] = 0.0  # one of the copies at a corner
    shown: list[np.ndarray] = []
    steps = approximate_steps(points, faces, Settings(**QUICK, keep_iterations=True), weights=weights)
    result = run_to_end(steps, lambda step: shown.append(step.vertices) if step.surface else None)
    assert shown
    assert {array.shape for array in shown} == {points.shape}
    assert result.history is not None
    assert result.history.shape[1:] == points.shape
    held = (np.linalg.norm(points[:, None] - points[weights == 0.0][None], axis=2) < 1e-9).any(axis=1)
    assert np.array_equal(result.vertices[held], points[held])
    finer = resample(result.representation, 2)
    assert open_edges(finer.vertices, np.stack(finer.polygons())) == 0


def test_early_end_and_marked_creases() -> None:
    points, faces = split("soup")
    settings = Settings(**QUICK, mark_creases=True)
    result = run_to_end(approximate_steps(points, faces, settings), lambda step: FINISH)
    assert result.report["ended_early"]
    assert result.creases is not None
    assert result.creases.max(initial=0) < len(points)


def test_denoising_holds_the_copies_together() -> None:
    clean, faces = ball(17)
    noisy = clean + 0.01 * np.random.default_rng(3).normal(size=clean.shape)
    points, split_faces = halves(noisy, faces, 0.0)
    result = approximate(points, split_faces, Settings(**QUICK, denoise="only"))
    assert open_edges(result.vertices, split_faces) == 0
    assert np.abs(result.vertices - points).max() > 1e-3
    assert np.allclose(result.vertices[: len(noisy)], denoise(noisy, faces).vertices, atol=1e-9)

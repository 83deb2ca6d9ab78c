"""Vertices and faces renumbered for a smaller file: the same surface over the same mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sparse_surface.solver import Settings, approximate, load
from sparse_surface.solver.surface.format.ordering import in_walking_order
from sparse_surface.solver.surface.representation import Representation

QUICK = {"ring": 4, "iterations": 2, "sweeps": 0, "workers": 1}


def folded(size: int = 14) -> tuple[np.ndarray, np.ndarray]:
    """Return a folded sheet of quads."""
    x, y = (part.ravel() for part in np.meshgrid(*2 * [np.linspace(-1.0, 1.0, size)], indexing="ij"))
    i = np.arange(size * size).reshape(size, size)
    quads = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=2).reshape(-1, 4)
    return np.stack([x, y, 0.5 * np.abs(0.8 * x + 0.6 * y) + 0.1 * np.sin(3.0 * y)], axis=1), quads


def shuffled(vertices: np.ndarray, faces: list[list[int]]) -> tuple[np.ndarray, list[list[int]]]:
    random = np.random.default_rng(5)
    number = random.permutation(len(vertices))
    turned = [np.roll(number[face], random.integers(len(face))).tolist() for face in faces]
    return vertices[np.argsort(number)], [turned[k] for k in random.permutation(len(faces))]


def mixed() -> tuple[np.ndarray, list[list[int]]]:
    """Return two sheets of quads and triangles, a hole, an edge with three faces, and vertices without faces."""
    vertices, quads = folded()
    faces: list[list[int]] = []
    for k, (a, b, c, d) in enumerate(quads.tolist()):
        if k != 70:
            faces += [[a, b, c, d]] if k % 3 else [[a, b, c], [a, c, d]]
    count = len(vertices)
    faces += [[v + count for v in face] for face in faces]
    vertices = np.concatenate([vertices, vertices + np.array([5.0, 0.0, 1.0]), [[0, 0, 9], [0.1, 0.1, 3], [1, 0, 9]]])
    return vertices, [*faces, [90, 104, 2 * count + 1]]


def triangles_of(size: int) -> tuple[np.ndarray, list[list[int]]]:
    vertices, quads = folded(size)
    return vertices, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]).tolist()


def seen(surface: Representation) -> dict[tuple[float, ...], np.ndarray]:
    """Return where the surface lies over the middle of each triangle, by the middle of the flat one."""
    flat = surface.vertices[surface.triangles].mean(axis=1)
    middle = np.full((len(flat), 3), 1.0 / 3.0)
    points = surface.evaluate(np.arange(len(flat)), middle)
    return {tuple(np.round(place, 9).tolist()): point for place, point in zip(flat, points, strict=True)}


def faces_of(surface: Representation) -> set[tuple[tuple[float, ...], ...]]:
    """Return each face as its corners' places, from the smallest on."""
    found = set()
    for start, end in zip(surface.face_offsets[:-1], surface.face_offsets[1:], strict=True):
        places = [tuple(surface.vertices[v].tolist()) for v in surface.face_corners[start:end]]
        at = places.index(min(places))
        found.add(tuple(places[at:] + places[:at]))
    return found


@pytest.mark.parametrize(
    ("mesh", "creases"),
    [(triangles_of(14), "auto"), (mixed(), "off"), (triangles_of(3), "off")],
    ids=["folded", "mixed", "small"],
)
def test_the_surface_and_its_mesh_are_the_same(mesh: tuple[np.ndarray, list[list[int]]], creases: str) -> None:
    surface = approximate(*shuffled(*mesh), Settings(creases=creases, **QUICK)).representation
    walked = in_walking_order(surface)
    assert faces_of(walked) == faces_of(surface)
    assert sorted(walked.vertices.tolist()) == sorted(surface.vertices.tolist())
    assert len(walked.creases) == len(surface.creases)
    before, after = seen(surface), seen(walked)
    assert before.keys() == after.keys()
    assert max(np.abs(after[place] - point).max() for place, point in before.items()) < 1e-12
    by_place = {tuple(p): q for p, q in zip(surface.vertices.tolist(), surface.at_vertices(), strict=True)}
    moved = [by_place[tuple(p)] - q for p, q in zip(walked.vertices.tolist(), walked.at_vertices(), strict=True)]
    assert np.abs(moved).max() < 1e-12


@pytest.mark.parametrize("quality", ["exact", "compact", "plain"])
def test_a_file_in_walking_order_is_smaller_and_gives_the_same_surface(quality: str, tmp_path: Path) -> None:
    surface = approximate(*shuffled(*triangles_of(30)), Settings(**QUICK)).representation
    kept, free = tmp_path / "kept.npz", tmp_path / "free.npz"
    surface.save(kept, quality)
    surface.save(free, quality, keep_vertex_order=False)
    assert free.stat().st_size < kept.stat().st_size - 2000
    saved, side = load(free), 2.0
    expected = in_walking_order(surface).at_vertices()
    assert np.abs(saved.at_vertices() - expected).max() < (1e-5 if quality == "compact" else 5e-7) * side
    assert len(load(kept).vertices) == len(saved.vertices)
    # a walk of the walk changes nothing that the coding of triangles would notice
    again = in_walking_order(saved)
    assert np.array_equal(again.triangles, saved.triangles)

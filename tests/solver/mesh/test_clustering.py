"""Coarser meshes against what they are made from: closed forms of a sphere, nearest neighbours, sets of Python."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver.mesh import clustering as coarsening
from sparse_surface.solver.mesh.clustering import coarsen, one_number
from sparse_surface.solver.mesh.normals import triangle_areas

MODELS = {"sphere": models.sphere(24), "cube": models.cube(), "moebius": models.moebius(), "l_solid": models.l_solid()}


def triangles_of(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return triangles, quads split along a diagonal."""
    fan = [faces[:, [0, second, second + 1]] for second in range(1, faces.shape[1] - 1)]
    return np.concatenate(fan)


def test_a_small_mesh_stays_as_it_is() -> None:
    vertices, faces = MODELS["cube"]
    triangles = triangles_of(np.asarray(faces))
    kept, coarse = coarsen(vertices, triangles, len(triangles))
    np.testing.assert_array_equal(kept, np.arange(len(vertices)))
    np.testing.assert_array_equal(coarse, triangles)


@given(name=st.sampled_from(sorted(MODELS)), most=st.integers(4, 2000), scale=st.floats(1e-6, 1e6))
def test_it_has_the_vertices_and_no_more_triangles_than_asked_for(name: str, most: int, scale: float) -> None:
    vertices, faces = MODELS[name]
    triangles = triangles_of(np.asarray(faces))
    kept, coarse = coarsen(scale * vertices, triangles, most)
    assert len(coarse) <= most
    assert np.all(np.diff(kept) > 0)
    assert kept[0] >= 0
    assert kept[-1] < len(vertices)
    if len(coarse):
        assert coarse.min() >= 0
        assert coarse.max() < len(kept)
    as_sets = {frozenset(row) for row in coarse.tolist()}
    assert len(as_sets) == len(coarse)
    assert all(len(each) == 3 for each in as_sets)


@pytest.mark.parametrize("most", [300, 1000, 3000])
def test_a_sphere_stays_one(most: int) -> None:
    """Area, volume with its sign, and the distance to the nearest vertex that is kept."""
    vertices, faces = models.sphere(48)
    vertices = vertices / np.linalg.norm(vertices, axis=1)[:, None]
    kept, coarse = coarsen(vertices, faces, most)
    assert len(coarse) > most / 3
    corners = vertices[kept][coarse]
    assert triangle_areas(vertices[kept], coarse).sum() == pytest.approx(4.0 * np.pi, rel=40.0 / most)
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
    before = vertices[np.asarray(faces)]
    sign = np.sign(np.einsum("ij,ij->i", before[:, 0], np.cross(before[:, 1], before[:, 2])).sum())
    assert sign * volume == pytest.approx(4.0 * np.pi / 3.0, rel=80.0 / most)
    reach = cKDTree(vertices[kept]).query(vertices)[0].max()
    equal_triangles = np.sqrt(4.0 * np.pi / most)
    assert reach < 3.0 * equal_triangles


@pytest.mark.parametrize("length", [0.0, 1.0, 1e9])
def test_a_mesh_without_area_ends_too(length: float) -> None:
    line = length * np.stack([np.arange(9.0), np.zeros(9), np.zeros(9)], axis=1)
    kept, coarse = coarsen(line, np.stack([np.arange(7), np.arange(7) + 1, np.arange(7) + 2], axis=1), 3)
    assert len(kept) >= 1
    assert len(coarse) <= 3


def test_a_sample_of_triangles_tells_the_area(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = models.sphere(24)
    whole = coarsen(vertices, faces, 1000)[1]
    monkeypatch.setattr(coarsening, "SAMPLE", 700)
    assert 0.8 < len(coarsen(vertices, faces, 1000)[1]) / len(whole) < 1.25


@pytest.mark.parametrize("largest", [3, 2**20, 2**40])
def test_rows_have_one_number_each(largest: int) -> None:
    rows = np.random.default_rng(7).integers(0, largest, (400, 3))
    rows = np.concatenate([rows, rows[::3]])
    numbers = one_number(rows)
    as_rows = [tuple(row) for row in rows.tolist()]
    assert len(set(numbers.tolist())) == len(set(as_rows)) == len(set(zip(as_rows, numbers.tolist(), strict=True)))


def test_numbers_come_in_the_order_of_the_rows() -> None:
    for largest in (5, 2**40):
        rows = np.random.default_rng(8).integers(0, largest, (300, 3))
        order = np.lexsort(rows.T[::-1])
        assert np.all(np.diff(one_number(rows)[order]) >= 0)

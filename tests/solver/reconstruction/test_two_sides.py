"""Thin plates seen from both sides: given normals say that they are two layers, and where inside is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sparse_surface.solver import CloudSettings, Settings, run_to_end
from sparse_surface.solver.interchange import CloudArrays, CloudOutcome
from sparse_surface.solver.reconstruction.evaluated import reconstruct_arrays
from sparse_surface.solver.reconstruction.two_sides import outward_normals

Array = np.ndarray


def plate(count: int, thick: float) -> tuple[Array, Array]:
    """Points of the surface of a box 1 x 0.6 x `thick`, spread evenly by area, with normals."""
    random, size = np.random.default_rng(0), np.array([1.0, 0.6, thick])
    area = size.prod() / size
    axis = random.choice(3, count, p=area / area.sum())
    side, row = random.choice([-1.0, 1.0], count), np.arange(count)
    points, normals = random.uniform(-0.5, 0.5, (count, 3)), np.zeros((count, 3))
    points[row, axis], normals[row, axis] = 0.5 * side, side
    return points * size, normals


def off_plate(places: Array, thick: float) -> Array:
    """Distance of places (N, 3) from that surface."""
    beyond = np.abs(places) - 0.5 * np.array([1.0, 0.6, thick])
    return np.where((beyond < 0.0).all(axis=1), -beyond.max(axis=1), np.linalg.norm(np.maximum(beyond, 0.0), axis=1))


def solved(points: Array, normals: Array | None) -> CloudOutcome:
    given = None if normals is None else normals.astype(np.float32)
    arrays = replace(CloudArrays.of_points(points.astype(np.float32), CloudSettings()), normals=given)
    return run_to_end(reconstruct_arrays(arrays, Settings(workers=1, iterations=4)))


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["outwards", "inwards"])
def test_a_thin_plate_has_two_sides(sign: float) -> None:
    points, normals = plate(3000, 0.02)
    random = np.random.default_rng(1)
    result = solved(points, sign * (normals + 0.1 * random.normal(size=normals.shape)))
    assert (result.report["pieces"], result.report["euler"]) == (1, 2)
    assert result.report["input"]["normals_used"]
    off = off_plate(result.vertices.astype(float), 0.02)
    assert np.sqrt(np.mean(off**2)) < 3e-3, "a seventh of the points' spacing"
    assert off.max() < 0.025
    flat = np.abs(result.vertices[:, :2]).max(axis=1) < 0.25
    assert np.abs(result.vertices[flat, 2]).min() > 0.005, "no vertex lies between the layers"


def test_normals_that_show_no_thin_part_change_nothing() -> None:
    random = np.random.default_rng(2)
    u = random.uniform(-1.0, 1.0, (1500, 2))
    points = np.column_stack([u, 0.2 * np.sin(3.0 * u[:, 0])])
    signs = random.choice([-1.0, 1.0], 1500)[:, None]
    with_normals = solved(points, signs * [0.0, 0.0, 1.0])
    assert "normals_used" not in with_normals.report["input"]
    np.testing.assert_array_equal(with_normals.vertices, solved(points, None).vertices)


def test_which_side_is_out() -> None:
    points, normals = plate(3000, 0.02)
    for given in (normals, -normals, 7.0 * normals):
        np.testing.assert_allclose(outward_normals(points, given), normals, atol=1e-12)
    thick, their = plate(3000, 0.5)
    assert outward_normals(thick, their) is None
    assert outward_normals(points, np.zeros_like(points)) is None

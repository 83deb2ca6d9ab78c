"""Triangles much larger than their neighbours: the surface stays near them, and the report says how near."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial import Delaunay
from sparse_surface.solver import Settings, approximate

GRID = np.array([(12 - i - j, i, j) for i in range(13) for j in range(13 - i)]) / 12.0
"""91 points of every triangle."""


def sheet(cells: int) -> tuple[np.ndarray, np.ndarray]:
    y, x = np.mgrid[0 : cells + 1, 0 : cells + 1].astype(float)
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    return np.column_stack([x.ravel(), y.ravel(), 0.0 * x.ravel()]), np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])


def needle() -> Any:
    vertices, faces = sheet(24)
    vertices[312, 2] = 600.0
    return vertices, faces


def spikes() -> Any:
    vertices, faces = sheet(28)
    vertices[:, 2] = np.where(np.random.default_rng(2).random(len(vertices)) < 0.012, 7.0, 0.0)
    return vertices, faces


def far_corners() -> Any:
    vertices, faces = sheet(20)
    vertices[:, 2] = np.sin(vertices[:, 0]) * np.cos(vertices[:, 1])
    edge = np.arange(21) * 21 + 20
    fan = np.column_stack([edge[:-1], np.full(20, len(vertices)), edge[1:]])
    return np.vstack([vertices, [[8e3, 10.0, 30.0]]]), np.concatenate([faces, fan])


def cliff() -> Any:
    vertices, faces = sheet(26)
    vertices[:, 2] = np.where(vertices[:, 0] > 13, 80.0, 0.0)
    return vertices, faces


def spike_on_the_border() -> Any:
    vertices, faces = sheet(39)
    vertices[:, 2] = np.where(np.random.default_rng(1).random(len(vertices)) < 0.01, 8.0, 0.0)
    return vertices, faces


def strips() -> Any:
    """Half a pipe of 199 strips, each 10,000 long and 0.016 wide: errors of 3e-7 of the length."""
    angle = np.linspace(0.0, np.pi, 200)
    arc = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    first = np.arange(199)
    quads = np.column_stack([first, first + 1, first + 201, first + 200])
    return np.vstack([arc, arc + np.array([0.0, 0.0, 1e4])]), np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])


MESHES = {
    "needle": needle,
    "spike on the border": spike_on_the_border,
    "strips": strips,
    "spikes": spikes,
    "far corners": far_corners,
    "cliff": cliff,
}


def dense_points(result: Any) -> tuple[np.ndarray, np.ndarray]:
    """Points of the surface at the grid, (T, 91, 3), and of the flat triangles."""
    surface = result.representation
    count = len(surface.triangles)
    points = surface.evaluate(np.repeat(np.arange(count), len(GRID)), np.tile(GRID, (count, 1)))
    flat = np.einsum("qk,tkd->tqd", GRID, surface.vertices[surface.triangles])
    return points.reshape(flat.shape), flat


@pytest.mark.parametrize("name", MESHES)
def test_the_report_says_what_dense_points_show_and_the_surface_stays_in_the_box(name: str) -> None:
    vertices, faces = MESHES[name]()
    result = approximate(vertices, faces, Settings(workers=1))
    points, flat = dense_points(result)
    largest, report = np.linalg.norm(points - flat, axis=2).max(), result.report
    assert largest <= 1.02 * report["surface_error"]["max"]
    assert largest <= report["surface_error"]["bound"]
    side = report["input"]["bounding_box_longest_side"]
    out = max((points - vertices.max(axis=0)).max(), (vertices.min(axis=0) - points).max())
    assert out <= 0.02 * side
    assert report["vertices_reproduced"] < len(vertices)


def dense_centre() -> Any:
    """A coarse frame around a very dense, noisy centre."""
    rng = np.random.default_rng(1)
    points = np.vstack([10.0 * rng.uniform(-1.0, 1.0, (60, 2)), rng.normal(0.0, 0.05, (1500, 2))])
    height = np.where(np.hypot(*points.T) < 1.0, 0.02 * rng.normal(size=len(points)), 0.0)
    return np.column_stack([points, height]), Delaunay(points).simplices


@pytest.mark.parametrize(("make", "share", "sweeps"), [(spikes, 0.01, 0), (cliff, 0.01, 0), (dense_centre, 0.001, 1)])
def test_a_tolerance_is_kept_at_dense_points(make: Any, share: float, sweeps: int) -> None:
    vertices, faces = make()
    tolerance = share * float(np.ptp(vertices, axis=0).max())
    result = approximate(vertices, faces, Settings(workers=1, sweeps=sweeps, tolerance=tolerance))
    points, flat = dense_points(result)
    assert np.linalg.norm(points - flat, axis=2).max() <= tolerance
    assert result.report["tolerance"]["achieved"] <= tolerance
    assert result.report["vertices_reproduced"] < len(vertices)

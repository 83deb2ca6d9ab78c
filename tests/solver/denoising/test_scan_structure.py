"""Depth levels and scan lines are noise; stairs, terraces and regular relief are shape."""

from __future__ import annotations

import numpy as np
import pytest
from noisy import Array, Indices, distance_from_clean, halved
from sparse_surface.solver import denoise
from sparse_surface.solver.denoising.found_noise import find_noise
from sparse_surface.solver.denoising.noise_level import estimate_noise_level
from sparse_surface.solver.denoising.noise_spectrum import correlated_noise
from sparse_surface.solver.denoising.scan_structure import depth_rounding, scan_lines
from sparse_surface.solver.denoising.surface import Surface, build_surface
from sparse_surface.solver.mesh.triangle_mesh import TriangleMesh, build_mesh

WIDE, HIGH = 84, 66


def sheet(kind: str) -> tuple[Array, Indices]:
    """Return a height field over a grid with edges of length 1."""
    row, column = np.divmod(np.arange(HIGH * WIDE), WIDE)
    x, y = column - 0.5 * WIDE, row - 0.5 * HIGH
    heights = {
        "saddle": 0.006 * (x**2 - 1.3 * y**2) + 0.11 * x * 0.7,
        "ridge": -0.53 * np.abs(x - 0.21 * y) + 0.093 * y,
        "swell": 3.1 * np.cos(x / 13.7 + 0.4 * y / 9.1) + 0.13 * y,
        "slope": 0.283 * x - 0.171 * y,
    }[kind]
    number = np.arange(HIGH * WIDE).reshape(HIGH, WIDE)
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    return np.column_stack([x, y, heights]), halved(quads)


def rounded(vertices: Array, step: float, before: float, seed: int) -> Array:
    """Return the heights rounded to levels that lie anywhere, after noise of a standard deviation."""
    rng = np.random.default_rng(seed)
    start, result = rng.random() * step, vertices.copy()
    result[:, 2] += rng.normal(0.0, before, len(vertices)) - start
    result[:, 2] = start + step * np.round(result[:, 2] / step)
    return result


def with_lines(vertices: Array, level: float, seed: int, rows: bool = True) -> Array:
    """Return the vertices with a random offset for each row, or column, of the grid."""
    offsets, result = np.random.default_rng(seed).normal(0.0, level, max(WIDE, HIGH)), vertices.copy()
    row, column = np.divmod(np.arange(HIGH * WIDE), WIDE)
    result[:, 2] += offsets[row if rows else column]
    return result


def is_better(clean: Array, triangles: Indices, noisy: Array, angle: float, distance: float) -> None:
    before = distance_from_clean(clean, triangles, noisy)
    after = distance_from_clean(clean, triangles, denoise(noisy, triangles).vertices)
    assert after[1] <= angle * before[1]
    assert after[0] <= distance * before[0]


@pytest.mark.parametrize("kind", ["saddle", "ridge", "swell", "slope"])
@pytest.mark.parametrize(("step", "before"), [(0.4, 0.0), (0.8, 0.0), (0.7, 0.15)])
def test_depth_levels_are_noise(kind: str, step: float, before: float) -> None:
    clean, triangles = sheet(kind)
    noisy = rounded(clean, step, before, 91)
    errors = float((noisy - clean)[:, 2].std())
    assert 0.7 * errors <= find_noise(*_mesh(noisy, triangles)).level <= 1.5 * errors
    is_better(clean, triangles, noisy, 0.25, 0.65)


@pytest.mark.parametrize("axis", [0, 1])
def test_levels_are_found_along_any_axis_and_upside_down(axis: int) -> None:
    clean, triangles = sheet("saddle")
    noisy = rounded(clean, 0.8, 0.0, 92)
    turned = np.roll(noisy, axis + 1, axis=1) * [1.0, -1.0, 1.0]
    assert depth_rounding(build_mesh(turned, triangles)) == pytest.approx(depth_rounding(build_mesh(noisy, triangles)))
    turned[::2] = turned[::2].astype(np.float32)  # as files store them
    assert depth_rounding(build_mesh(turned, triangles)) == pytest.approx(0.8 / np.sqrt(12), rel=0.15)


def test_levels_farther_away_may_be_farther_apart() -> None:
    """A stereo camera rounds disparities, and so one over the depth; points lie on its rays."""
    far, focus = 300.0, 300.0
    heights, triangles = sheet("swell")
    depth = far - heights[:, 2]
    steps = far**2 / 0.7  # levels 0.7 apart at this depth
    levels = steps / np.round(steps / depth)
    rays = np.column_stack([heights[:, :2] / focus, np.ones(len(depth))])
    clean, noisy = rays * depth[:, None], rays * levels[:, None]
    assert depth_rounding(build_mesh(noisy, triangles)) == pytest.approx(0.7 / np.sqrt(12), rel=0.2)
    is_better(clean, triangles, noisy, 0.25, 0.65)


@pytest.mark.parametrize("kind", ["saddle", "ridge", "swell", "slope"])
@pytest.mark.parametrize("rows", [True, False])
def test_scan_lines_are_noise(kind: str, rows: bool) -> None:
    clean, triangles = sheet(kind)
    noisy = with_lines(clean, 0.25, 93, rows)
    errors = float((noisy - clean)[:, 2].std())
    assert find_noise(*_mesh(noisy, triangles)).level == pytest.approx(errors, rel=0.2)
    is_better(clean, triangles, noisy, 0.2, 0.75)


def test_lines_and_independent_noise_are_told_together() -> None:
    clean, triangles = sheet("slope")
    noisy = with_lines(clean, 0.2, 94)
    noisy[:, 2] += np.random.default_rng(95).normal(0.0, 0.12, len(noisy))
    mesh, surface = _mesh(noisy, triangles)
    relief = estimate_noise_level(mesh, surface).relief
    assert scan_lines(mesh, relief) > 0.0
    found = correlated_noise(mesh, np.tile([0.0, 0.0, 1.0], (mesh.node_count, 1)), has_lines=True)
    assert found is not None
    lines = np.var((noisy - clean)[:, 2]) - 0.12**2
    assert found.level == pytest.approx(np.sqrt(lines + 0.12**2), rel=0.15)
    # Means over disks of two rings, whose rows have 3, 4, 5, 4 and 3 vertices, show 75 / 19 times as much of lines.
    expected = np.sqrt((lines * 75 / 19 + 0.12**2) / (lines + 0.12**2))
    assert found.inflation == pytest.approx(expected, rel=0.15)


def stairs(kind: str) -> tuple[Array, Indices]:
    """Return treads with risers one edge long, on which nothing is noise."""
    vertices, triangles = sheet("slope")
    x, y = vertices[:, :2].T
    heights = {
        "straight": 0.5 * np.floor(x / 2),
        "three": 0.7 * np.floor(x / 3),
        "wide": 0.6 * np.floor(x / 9),
        "round": 0.8 * np.floor(np.hypot(x, y) / 11),
        "slope": 0.5 * x,
        "pyramid": 0.5 * np.maximum(np.abs(x), np.abs(y)),
        "grooves": -0.4 * (y % 5 == 0),
        "ribs": 0.4 * (y % 9 < 4.5),
        "waves": 0.3 * np.sin(2 * np.pi * y / 7),
        "bricks": 0.4 * ((x % 8 > 0) & (y % 4 > 0)),
        "rows of bricks": 0.7 * (((x + y // 8 * 12) % 24 > 2) & (y % 8 > 2)),
        "long bricks": ((x + y // 8 * 20) % 40 > 2) & (y % 8 > 2),
    }[kind]
    return np.column_stack([x, y, heights]), triangles


STAIRS = ["straight", "three", "wide", "round", "slope", "pyramid"]
RELIEF = ["grooves", "ribs", "waves", "bricks", "rows of bricks", "long bricks"]


@pytest.mark.parametrize("kind", STAIRS + RELIEF)
def test_stairs_and_terraces_come_back_bit_for_bit(kind: str) -> None:
    vertices, triangles = stairs(kind)
    assert denoise(vertices, triangles).vertices.tobytes() == vertices.tobytes()


def test_levels_too_fine_to_be_removed_stay() -> None:
    clean, triangles = sheet("saddle")
    noisy = rounded(clean, 0.02, 0.0, 96)
    assert denoise(noisy, triangles).vertices.tobytes() == noisy.tobytes()


def test_independent_noise_has_neither_levels_nor_lines() -> None:
    for kind in ("saddle", "ridge", "swell", "slope"):
        clean, triangles = sheet(kind)
        clean[:, 2] += np.random.default_rng(97).normal(0.0, 0.2, len(clean))
        mesh, surface = _mesh(clean, triangles)
        assert depth_rounding(mesh) == 0.0
        assert scan_lines(mesh, estimate_noise_level(mesh, surface).relief) == 0.0


def _mesh(vertices: Array, triangles: Indices) -> tuple[TriangleMesh, Surface]:
    mesh = build_mesh(vertices, triangles)
    return mesh, build_surface(mesh)

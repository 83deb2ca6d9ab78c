"""What patches have levelled out comes back, noise does not; and how far off a guide is taken to be."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from noisy import Array, Indices, face_normals, halved
from scipy.ndimage import gaussian_filter
from sparse_surface.solver.denoising.missed_shape import bring_back
from sparse_surface.solver.denoising.normal_filter import guide_deviation
from sparse_surface.solver.denoising.one_sided_patches import PatchFitter, PatchRule
from sparse_surface.solver.denoising.seeds import signs
from sparse_surface.solver.denoising.surface import Surface, build_surface
from sparse_surface.solver.mesh.triangle_mesh import build_mesh

SIDE = 64
UP = np.tile([0.0, 0.0, 1.0], (SIDE * SIDE, 1))


def sheet(side: int = SIDE) -> tuple[Array, Indices, Surface]:
    """A square grid of triangles in the plane, side x side vertices."""
    row, column = np.divmod(np.arange(side * side), side)
    number = np.arange(side * side).reshape(side, side)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    vertices = np.column_stack([row, column, np.zeros(side * side)]).astype(np.float64)
    triangles = halved(quads)
    return vertices, triangles, build_surface(build_mesh(vertices, triangles))


def patches(triangles: Indices, responses: Array, sizes: Array | float = 60.0) -> Any:
    """As much of a `PatchAverage` as is asked of it: every vertex is known."""
    count = len(responses)
    planes = np.zeros((count, 3, 3)), np.zeros((count, 3)), np.ones(count)
    return SimpleNamespace(
        planes=lambda: planes, responses=lambda: responses, patch_sizes=np.broadcast_to(sizes, len(triangles))
    )


def raised(vertices: Array, heights: Array) -> Array:
    return vertices + UP * heights[:, None]


def smooth(heights: Array, width: float) -> Array:
    """A linear smoother: the same weights for all heights."""
    return gaussian_filter(heights.reshape(SIDE, SIDE), width, mode="nearest").ravel()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_relief_that_was_levelled_out_comes_back_nearly_as_far_as_the_truth_would_have_it(seed: int) -> None:
    """On one half of a sheet, under patches of another size; the best share is known from the truth."""
    vertices, triangles, surface = sheet()
    rng = np.random.default_rng(seed)
    bumpy = vertices[:, 0] < SIDE / 2
    relief = np.where(bumpy, 0.6 * np.sin(vertices[:, 0] / 2.0) * np.sin(vertices[:, 1] / 2.0), 0.0)
    noise = rng.normal(0.0, 1.0, len(vertices))
    noisy, moved = raised(vertices, relief + noise), raised(vertices, smooth(noise, 2.0))
    sizes = np.where(bumpy[triangles].all(axis=1), 60.0, 400.0)
    average = patches(triangles, smooth(signs(len(vertices)), 2.0), sizes)
    found = bring_back(noisy, moved, UP, surface, average, 1.0, 10.0)
    np.testing.assert_array_equal(found[:, :2], vertices[:, :2])
    inside, outside = vertices[:, 0] < SIDE / 2 - 12, vertices[:, 0] > SIDE / 2 + 12
    before, after, wanted = moved[:, 2] - relief, found[:, 2] - relief, found[:, 2] - moved[:, 2]
    best = -(before @ wanted) / (wanted @ wanted)
    assert 0.7 < best < 2.0  # 1 is where the truth would stop
    assert np.mean(after[inside] ** 2) < 0.75 * np.mean(before[inside] ** 2)
    assert np.mean(after[outside] ** 2) < 1.05 * np.mean(before[outside] ** 2)


@pytest.mark.parametrize("width", [0.8, 1.5, 3.0])
def test_noise_does_not_come_back(width: float) -> None:
    """A plane, whatever the smoother has left of the noise: its residuals have that in common, negative or positive."""
    vertices, triangles, surface = sheet()
    noise = np.random.default_rng(5).normal(0.0, 1.0, len(vertices))
    average = patches(triangles, smooth(signs(len(vertices)), width))
    noisy, moved = raised(vertices, noise), raised(vertices, smooth(noise, width))
    found = bring_back(noisy, moved, UP, surface, average, 1.0, 10.0)
    assert np.mean((found - vertices) ** 2) <= 1.01 * np.mean((moved - vertices) ** 2)


def test_wild_vertices_are_no_shape() -> None:
    """One in fifty is off by ten noise levels: the residuals' variance is three times that of the noise."""
    vertices, triangles, surface = sheet()
    rng = np.random.default_rng(6)
    noise = np.where(rng.random(len(vertices)) < 0.02, 10.0, 1.0) * rng.normal(0.0, 1.0, len(vertices))
    noisy = raised(vertices, noise)
    average = patches(triangles, np.zeros(len(vertices)))
    found = bring_back(noisy, vertices, UP, surface, average, 1.0, 100.0)
    assert np.sqrt(np.mean((found - vertices) ** 2)) < 0.03


def test_what_few_vertices_show_is_no_evidence_and_moves_are_limited() -> None:
    """Fewer than 200 vertices stay bit for bit; elsewhere no vertex moves farther than it may."""
    vertices, triangles, surface = sheet()
    heights = 3.0 * np.sin(vertices[:, 0] / 3.0)
    heights += np.random.default_rng(7).normal(0.0, 0.1, len(heights))
    noisy, average = raised(vertices, heights), patches(triangles, np.zeros(len(vertices)))
    found = bring_back(noisy, vertices, UP, surface, average, 0.1, 1.5)
    lengths = np.linalg.norm(found - noisy, axis=1)
    assert lengths.max() <= 1.5 * (1 + 1e-12)
    assert np.abs(heights).max() > 2.5
    small, few, its = sheet(14)
    up = UP[: len(small)]
    noisy = small + up * np.sin(small[:, :1] / 2.0)
    kept = bring_back(noisy, small, up, its, patches(few, np.zeros(196)), 0.01, 10.0)
    assert kept.tobytes() == small.tobytes()


def test_a_patch_answers_to_signs_as_to_heights() -> None:
    """Weighted least squares of the signs, curvature shrunk as that of the heights: to nothing, or hardly at all."""
    vertices, triangles, surface = sheet(16)
    rng = np.random.default_rng(4)
    rule = PatchRule((60,), normal_width=0.3, largest_change=4.0, caution=1.0, misfit_power=1.0)
    for curvature, terms in ((0.0, 3), (0.1, 6)):
        bent = vertices.copy()
        bent[:, 2] = curvature * (vertices[:, 0] - 7.5) ** 2 + rng.normal(0.0, 1e-3, 256)
        guide = np.column_stack(
            [-2 * curvature * (bent[triangles].mean(axis=1)[:, 0] - 7.5), np.zeros(450), np.ones(450)]
        )
        guide /= np.linalg.norm(guide, axis=1, keepdims=True)
        (fits,) = PatchFitter(surface, bent, guide, 1e-3 if curvature else 3e-3, rule).fits(np.array([112]))
        present = fits.vertices[0] >= 0
        u, v = fits.at_vertex[0][:, present]
        root = np.sqrt(fits.vertex_weights[0, present])
        design = np.stack([u**0, u, v, u * u, u * v, v * v], axis=1)[:, :terms]
        drawn = signs(256)[fits.vertices[0, present]]
        expected = design @ np.linalg.lstsq(root[:, None] * design, root * drawn, rcond=None)[0]
        np.testing.assert_allclose(fits.responses[0, present], expected, atol=0.02)


def test_signs_are_as_often_one_as_minus_one_and_neighbours_differ_as_often_as_not() -> None:
    drawn = signs(10_000)
    assert set(drawn) == {-1.0, 1.0}
    assert abs(drawn.mean()) < 0.04
    assert all(abs((drawn[gap:] * drawn[:-gap]).mean()) < 0.04 for gap in (1, 2, 3, 100))


def test_a_guide_is_off_as_far_as_noise_tilts_triangles() -> None:
    """Against equilateral triangles with noise on them; a far sphere bends as a quadratic does."""
    vertices, triangles, surface = sheet()
    even = np.column_stack([vertices[:, 0] - vertices[:, 1] / 2, np.sqrt(0.75) * vertices[:, 1], vertices[:, 2]])
    even[:, 2] = np.random.default_rng(9).normal(0.0, 0.05, len(even))
    flat = np.tile([0.0, 0.0, 1.0], (len(triangles), 1))
    tilt = face_normals(even, triangles)[:, :2].std()
    assert guide_deviation(surface, flat, 0.05) == pytest.approx(tilt, rel=0.03)
    centres = np.column_stack([vertices[triangles].mean(axis=1)[:, :2] - SIDE / 2, np.full(len(triangles), 200.0)])
    assert guide_deviation(surface, centres / np.linalg.norm(centres, axis=1, keepdims=True), 0.0) < 1e-4


def test_a_guide_that_bends_from_triangle_to_triangle_is_off_as_far_as_nearly_all_differ_from_those_around() -> None:
    _, triangles, surface = sheet(24)
    normals = np.random.default_rng(3).normal((0.0, 0.0, 1.0), 0.05, (len(triangles), 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    apart = []
    for number, corners in enumerate(triangles):
        around = np.isin(triangles, corners).any(axis=1)
        around[number] = False
        mean = normals[around].sum(axis=0)
        apart.append(np.linalg.norm(mean / np.linalg.norm(mean) - normals[number]))
    assert guide_deviation(surface, normals, 0.0) == pytest.approx(3.0 * np.median(apart), rel=1e-9)
    rule = PatchRule((14, 28), normal_width=0.16, largest_change=4.0, caution=0.85, misfit_power=1.0)
    assert rule.following(0.3) == rule
    assert rule.following(0.1) == replace(rule, normal_width=0.1)

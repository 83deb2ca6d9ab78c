"""The surface while it is being solved: quadrics against NumPy's own least squares, and what a run shows of itself."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.polynomial import polynomial
from sparse_surface.benchmarks.generated_models import cubetorus
from sparse_surface.solver import Settings, approximate
from sparse_surface.solver.approximation import preview as module
from sparse_surface.solver.approximation.preview import Preview, quadrics
from sparse_surface.solver.mesh.triangle_mesh import build_mesh
from sparse_surface.solver.patches.blending import blending_weights
from sparse_surface.solver.patches.cover import build_cover
from sparse_surface.solver.patches.patches import build_patches
from sparse_surface.solver.patches.splitting import with_domains
from sparse_surface.solver.progress import Progress


def numpys_quadric(domain: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The least-squares quadric at its points, by a singular value decomposition."""
    basis = polynomial.polyvander2d(domain[:, 0], domain[:, 1], (2, 2))[:, [0, 1, 2, 3, 4, 6]]
    return basis @ np.linalg.lstsq(basis, points, rcond=None)[0]


def ragged(sizes: list[int]) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(sizes)])


def test_quadrics_agree_with_numpy() -> None:
    random = np.random.default_rng(0)
    offsets = ragged([7, 40, 12])
    domains = random.normal(size=(offsets[-1], 2)) * 3.0 + [40.0, -7.0]
    points = random.normal(size=(offsets[-1], 3))
    fitted = quadrics(domains, points, offsets)
    for first, end in pairwise(offsets):
        expected = numpys_quadric(domains[first:end], points[first:end])
        np.testing.assert_allclose(fitted[first:end], expected, atol=1e-6)


def test_a_quadric_is_met_exactly() -> None:
    random = np.random.default_rng(1)
    u, v = random.normal(size=(2, 30))
    points = np.stack([1.0 + u - 2.0 * v, u * v - 3.0 * v * v, u * u], axis=1)
    fitted = quadrics(np.stack([u, v], axis=1), points, ragged([30]))
    np.testing.assert_allclose(fitted, points, atol=1e-7)


def test_few_and_equal_points_are_survived() -> None:
    domains = np.concatenate([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], np.zeros((4, 2))])
    points = np.concatenate([[[0.0, 0.0, 1.0], [1.0, 0.0, 2.0], [0.0, 1.0, 0.0]], np.ones((4, 3))])
    fitted = quadrics(domains, points, ragged([3, 4]))
    np.testing.assert_allclose(fitted, points, atol=1e-5)


def test_the_first_look_is_the_blend_of_all_quadrics(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = cubetorus()
    settings = Settings().resolved()
    mesh = build_mesh(vertices, faces)
    patches = build_patches(mesh, build_cover(mesh, settings.ring), settings.ring)
    patches, domains = with_domains(mesh, patches, settings)
    blending = blending_weights(mesh, patches, settings.blending)
    monkeypatch.setattr(module, "ENTRIES_AT_ONCE", len(patches.vertices) // 3)  # in several parts
    preview = Preview(mesh, patches, domains, blending)
    shown = preview.surface(mesh.vertices, [False] * len(patches))
    expected = np.zeros_like(mesh.vertices)
    for k, (first, end) in enumerate(pairwise(patches.vertex_offsets)):
        own = patches.vertices[first:end]
        assert (patches.vertex_patch[first:end] == k).all()
        fitted = numpys_quadric(domains[first:end], mesh.vertices[own])
        np.add.at(expected, own, blending[first:end, None] * fitted)
    np.testing.assert_allclose(shown, expected, atol=1e-6)
    assert np.linalg.norm(shown - mesh.vertices, axis=1).max() > 0.01  # creases are rounded off


def test_previews_begin_early_and_come_nearer() -> None:
    vertices, faces = cubetorus()
    off: list[float] = []
    fractions: list[float] = []

    def look(step: Progress) -> None:
        if step.vertices is not None:
            off.append(float(np.sqrt(((step.vertices - vertices) ** 2).sum(axis=1).mean())))
            fractions.append(step.fraction)

    done = approximate(vertices, faces, Settings(iterations=4, sweeps=1, workers=1, creases="off"), report=look)
    assert fractions[0] < 0.1
    assert len(off) > 3
    solving = [o for o, f in zip(off, fractions, strict=True) if f < 0.75]
    assert solving == sorted(solving, reverse=True)
    assert off[-1] < 0.25 * off[0]
    assert off[-1] == pytest.approx(np.sqrt((done.error**2).mean()))


def test_looking_changes_nothing() -> None:
    vertices, faces = cubetorus()
    settings = Settings(iterations=4, workers=1)
    unseen = approximate(vertices, faces, settings)

    def spoil(step: Progress) -> None:
        if step.vertices is not None:
            step.vertices.fill(0.0)

    seen = approximate(vertices, faces, settings, report=spoil)
    assert unseen.vertices.tobytes() == seen.vertices.tobytes()

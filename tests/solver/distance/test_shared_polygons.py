"""Alignment of copies that have the polygons of their original: as well as anyone could who knows all pairs."""

from __future__ import annotations

import numpy as np
import pytest
from distance_shapes import Floats, Shape, soup
from scipy.spatial.transform import Rotation
from sparse_surface.benchmarks.generated_models import cubetorus
from sparse_surface.solver.distance.alignment import Alignment, align_steps
from sparse_surface.solver.distance.shared_polygons import SHARED, Corners
from sparse_surface.solver.distance.surfaces import Surface
from sparse_surface.solver.mesh.triangle_mesh import build_mesh
from sparse_surface.solver.progress import run_to_end

NOISE = 2e-3


@pytest.fixture(scope="module")
def original() -> Shape:
    """Return a symmetric body, eight ways to lay it, whose vertices are not symmetric; its longest side is 1."""
    mesh = build_mesh(*cubetorus())
    return mesh.vertices, mesh.triangles


def scan_of(original: Shape, seed: int, scale: float = 1.0) -> tuple[Floats, Floats]:
    """Return noisy vertices in the original's place, and the same moved away."""
    rng = np.random.default_rng(seed)
    noisy = original[0] + NOISE * rng.normal(size=original[0].shape)
    turn = Rotation.random(random_state=seed).as_matrix()
    return noisy, scale * noisy @ turn.T + rng.normal(size=3)


def align(one: Shape, other: Shape, **options: bool) -> Alignment:
    return run_to_end(align_steps(Surface.of(*one), Surface.of(*other), **options))


def off(found: Alignment, away: Floats, noisy: Floats) -> float:
    """Return how far the worst vertex ends from where the noise alone leaves it."""
    return float(np.linalg.norm(away @ found.matrix[:3, :3].T + found.matrix[:3, 3] - noisy, axis=1).max())


def least_off(original: Shape, noisy: Floats) -> float:
    """Return the same for the best motion that knows which vertices belong together (Kabsch)."""
    (middle, goal), vertices = (each.mean(axis=0) for each in (noisy, original[0])), original[0]
    turn = Rotation.align_vectors(vertices - goal, noisy - middle)[0].as_matrix()
    return float(np.linalg.norm((noisy - middle) @ turn.T + goal - noisy, axis=1).max())


@pytest.mark.parametrize("seed", range(4))
def test_a_noisy_copy_comes_back_as_if_all_pairs_were_known(original: Shape, seed: int) -> None:
    noisy, away = scan_of(original, seed)
    found = align((away, original[1]), original)
    assert off(found, away, noisy) < 1.5 * least_off(original, noisy)
    assert found.residual < 1.1 * NOISE
    assert found.equally_good == 8


def test_polygons_tell_the_ways_to_lay_a_symmetric_body_apart(original: Shape) -> None:
    for seed in range(4):
        turn = Rotation.random(random_state=seed).as_matrix()
        away = original[0] @ turn.T + 3.0
        assert off(align((away, original[1]), original), away, original[0]) < 1e-13


def test_the_order_of_vertices_and_triangles_does_not_matter(original: Shape) -> None:
    rng = np.random.default_rng(1)
    order, rows = rng.permutation(len(original[0])), rng.permutation(len(original[1]))
    other = original[0][order], np.roll(np.argsort(order)[original[1][rows]], 1, axis=1)
    noisy, away = scan_of(original, 1)
    assert off(align((away, original[1]), other), away, noisy) < 1.5 * least_off(original, noisy)


def test_triangles_may_share_no_vertices(original: Shape) -> None:
    """An .stl names the corners of each triangle."""
    corners = np.arange(3 * len(original[1])).reshape(-1, 3)
    noisy, away = scan_of(original, 2)
    found = align((away[original[1]].reshape(-1, 3), corners), (original[0][original[1]].reshape(-1, 3), corners))
    assert off(found, away, noisy) < 1.5 * least_off(original, noisy)


def test_a_noisy_copy_of_another_size_comes_back(original: Shape) -> None:
    noisy, away = scan_of(original, 3, 0.4)
    found = align((away, original[1]), original, scaled=True)
    assert off(found, away, noisy) < 2.0 * least_off(original, noisy)


def test_a_part_that_was_edited_does_not_pull_the_rest(original: Shape) -> None:
    noisy, away = scan_of(original, 0)
    upper = original[0][:, 0] > 0.9 * original[0][:, 0].max()
    edited = away + np.where(upper, 0.05, 0.0)[:, None] * [1.0, 0.0, 0.0]
    found = align((edited, original[1]), original)
    assert off(found, away, noisy) < 4.0 * least_off(original, noisy)


def test_vertices_that_slid_within_the_surface_do_not_take_it_off(original: Shape) -> None:
    """All vertices inside the top and bottom moved the same way: pairs say that the body did, the surface did not."""
    vertices, triangles = original
    flat = np.isin(vertices[:, 2], [vertices[:, 2].min(), vertices[:, 2].max()])
    around = np.ones(len(vertices), dtype=bool)
    around[triangles[~flat[triangles].all(axis=1)]] = False
    slid = vertices + np.where(around, 0.004, 0.0)[:, None] * [1.0, 0.5, 0.0]
    found = align((slid + np.array([0.3, 0.2, 0.1]), triangles), (vertices, triangles))
    assert found.residual < 1e-12


def test_other_polygons_are_not_taken_for_the_same(original: Shape) -> None:
    """A finer mesh of the same surface has none of its triangles, a soup hardly any."""
    corners = Corners(Surface.of(*original))
    vertices, triangles = original
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    thirds = np.concatenate([0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)])
    middle = np.arange(len(thirds)).reshape(3, -1).T
    assert corners.pairs(thirds, middle).share < SHARED
    assert corners.pairs(*soup(500, 1)).share < 0.01
    assert corners.pairs(vertices, triangles).share == 1.0
    assert corners.pairs(vertices, triangles[:, ::-1]).share == 0.0

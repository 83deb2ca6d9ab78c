"""Gaps between patches against a comparison of every pair, and what sweeps do to them."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from sparse_surface.benchmarks.generated_models import cube
from sparse_surface.solver import Settings, approximate
from sparse_surface.solver.surface.overlaps import overlap_gaps
from synthetic import grid

QUICK = Settings(method="traditional", ring=4, degree=8, sparsity=8, sweeps=0)


def test_gaps_are_the_largest_distances_between_pairs_of_patches() -> None:
    surface = approximate(*cube(8), QUICK).representation
    points = surface.at_patch_vertices
    expected = np.zeros(len(surface.vertices))
    for vertex in range(len(surface.vertices)):
        own = points[surface.patch_vertices == vertex]
        expected[vertex] = max((np.linalg.norm(a - b) for a, b in combinations(own, 2)), default=0.0)
    assert expected.max() > 1e-3
    np.testing.assert_allclose(overlap_gaps(surface), expected, rtol=1e-12)


def test_exact_patches_have_no_gaps() -> None:
    plane, triangles = grid(24, seed=1)
    surface = approximate(np.column_stack([plane, plane @ [0.3, 0.1]]), triangles, QUICK).representation
    assert surface.patches > 5
    assert overlap_gaps(surface).max() < 1e-6


def test_vertices_of_fewer_than_two_patches_have_no_gap() -> None:
    surface = approximate(*cube(8), QUICK).representation
    members = np.bincount(surface.patch_vertices, minlength=len(surface.vertices))
    assert (members == 1).any()
    np.testing.assert_array_equal(overlap_gaps(surface)[members < 2], 0.0)

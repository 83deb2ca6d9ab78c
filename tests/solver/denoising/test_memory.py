"""Denoising a million vertices within 3 GB: what is computed for each pair of triangles comes and goes in parts."""

from __future__ import annotations

import tracemalloc

import numpy as np
from noisy import Array, Indices, halved
from sparse_surface.solver.denoising.normal_filter import filter_normals
from sparse_surface.solver.denoising.surface import build_surface
from sparse_surface.solver.mesh.triangle_mesh import build_mesh


def sheet(side: int) -> tuple[Array, Indices]:
    """Return a noisy sheet of side x side vertices as triangles."""
    number = np.arange(side * side).reshape(side, side)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    row, column = np.divmod(np.arange(side * side), side)
    height = np.random.default_rng(4).normal(0.0, 0.2, side * side)
    return np.column_stack([row, column, height]), halved(quads)


def test_neighbours_are_found_in_the_memory_of_a_few_tables() -> None:
    """The vertices' 24 pairs of triangles once with numbers of 8 bytes take 195 bytes a vertex; it was 1,600."""
    mesh = build_mesh(*sheet(200))
    tracemalloc.start()
    try:
        build_surface(mesh)
        assert tracemalloc.get_traced_memory()[1] / 200**2 < 800
    finally:
        tracemalloc.stop()


def test_filtering_holds_no_table_of_all_pairs_but_one() -> None:
    """A vertex has 24 pairs of triangles: one table of numbers takes 195 bytes of it, one of normals 590."""
    peaks = []
    for side in (200, 300):
        vertices, triangles = sheet(side)
        surface = build_surface(build_mesh(vertices, triangles))
        tracemalloc.start()
        try:
            filter_normals(surface, vertices, 0.2)
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    assert (peaks[1] - peaks[0]) / (300**2 - 200**2) < 800

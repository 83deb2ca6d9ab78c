"""The smooth surface beside a mesh: against shapes whose true surface is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from sparse_surface.benchmarks.generated_models import cube, sphere
from sparse_surface.solver.mesh.curved import curved_offsets, offsets_inside
from sparse_surface.solver.mesh.sampling import low_discrepancy
from sparse_surface.solver.mesh.triangle_mesh import TriangleMesh, build_mesh

Array = NDArray[np.float64]
SAMPLES = low_discrepancy(40)


def on_triangles(mesh: TriangleMesh) -> Array:
    return np.einsum("qk,tkd->tqd", SAMPLES, mesh.vertices[mesh.triangles])


def beside(mesh: TriangleMesh) -> tuple[Array, Array, Array]:
    """Places of the triangles, and where they go: without moved nodes and with them, (T, q, 3) each."""
    moves, bulges = curved_offsets(mesh)
    flat = on_triangles(mesh)
    through = flat + offsets_inside(mesh.nodes, np.zeros_like(moves), bulges, SAMPLES)
    return flat, through, flat + offsets_inside(mesh.nodes, moves, bulges, SAMPLES)


def test_bulges_lead_from_the_triangles_of_a_sphere_to_the_sphere() -> None:
    flat, through, balanced = (np.linalg.norm(x, axis=2) - 1.0 for x in beside(build_mesh(*sphere(12))))
    assert np.abs(through).max() < 0.02 * np.abs(flat).max()
    # as often outside the triangles as inside
    away = balanced - flat
    assert abs(away.mean()) < 0.02 * -flat.mean()
    assert (away**2).mean() < 0.25 * (flat**2).mean()


def test_they_are_exact_over_a_quadratic_function() -> None:
    cells = 12
    y, x = (grid.ravel() / cells - 0.5 for grid in np.mgrid[0 : cells + 1, 0 : cells + 1])
    # so low that vertical is normal to second order
    height = 1e-4 * (3.0 * x**2 - 2.0 * x * y + y**2)
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, -1)
    corners = (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1])
    a, b, c, d = (corner.ravel() for corner in corners)
    faces = np.concatenate([np.stack(triangle, axis=1) for triangle in ((a, b, c), (a, c, d))])
    mesh = build_mesh(np.stack([x, y, height], axis=1), faces)
    flat, through, _ = beside(mesh)
    # normals of the border are one-sided
    within = (np.abs(mesh.vertices[mesh.triangles][..., :2]) < 0.49).all(axis=(1, 2))
    true = 1e-4 * (3.0 * flat[..., 0] ** 2 - 2.0 * flat[..., 0] * flat[..., 1] + flat[..., 1] ** 2)
    np.testing.assert_allclose(through[within][..., 2], true[within], atol=1e-11)
    assert np.abs(flat[within][..., 2] - true[within]).max() > 1e-7


def test_flat_sides_and_steep_edges_stay() -> None:
    for part in curved_offsets(build_mesh(*cube(6))):
        assert np.abs(part).max() < 1e-15


@pytest.mark.parametrize("turned", [slice(0, None, 3), slice(None)])
def test_the_winding_of_the_input_does_not_matter(turned: slice) -> None:
    vertices, faces = sphere(6)
    other = faces.copy()
    other[turned] = other[turned][:, ::-1]
    (moves, bulges), (moves_too, bulges_too) = (curved_offsets(build_mesh(vertices, own)) for own in (faces, other))
    np.testing.assert_allclose(moves_too, moves, atol=1e-14)
    np.testing.assert_allclose(bulges_too.sum(axis=1), bulges.sum(axis=1), atol=1e-14)
    assert np.abs(moves).max() > 1e-3


def test_triangles_without_area_and_loose_vertices_stay_finite() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0], [5, 5, 5]])
    for part in curved_offsets(build_mesh(vertices, np.array([[0, 1, 2], [0, 3, 1]]))):
        assert np.isfinite(part).all()

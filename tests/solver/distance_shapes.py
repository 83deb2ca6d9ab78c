"""Shapes that the tests of distances share, made on the spot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

Floats = NDArray[np.float64]
Shape = tuple[Floats, NDArray[np.int64]]

BOX_QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def box(sides: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Shape:
    """Return a box around the origin, wound outwards."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * sides
    triangles = [(q[0], q[k], q[k + 1]) for q in BOX_QUADS for k in (1, 2)]
    return corners, np.array(triangles)


def ball(points: int = 400, radius: float = 1.0) -> Shape:
    """Return a polyhedron with its corners on a sphere, wound outwards."""
    z = 1.0 - (2.0 * np.arange(points) + 1.0) / points
    turn = np.pi * (1.0 + 5.0**0.5) * np.arange(points)
    flat = np.sqrt(1.0 - z * z)
    vertices = radius * np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
    triangles = ConvexHull(vertices).simplices.astype(np.int64)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    inward = (np.cross(b - a, c - a) * a).sum(axis=1) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    return vertices, triangles


def soup(count: int, seed: int) -> Shape:
    """Return triangles of very different sizes, some of them needles, that share no corner."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(-3.0, 0.3, (count, 1, 1))
    corners = rng.normal(size=(count, 1, 3)) + size * rng.normal(size=(count, 3, 3))
    corners[::5, 2] = corners[::5, 1] + 1e-4 * rng.normal(size=(len(corners[::5]), 3))
    return corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)

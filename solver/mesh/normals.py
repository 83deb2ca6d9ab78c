"""Normals and areas of triangles, and sums of them around vertices."""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices


def unit(vectors: Array) -> Array:
    """Return vectors (..., D) at length 1; those without a length stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0)


def area_vectors(vertices: Array, triangles: Indices) -> Array:
    """Return (b - a) x (c - a) of each triangle, (T, 3): along its normal, twice its area long."""
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    return np.asarray(np.cross(b - a, c - a), dtype=np.float64)


def triangle_areas(vertices: Array, triangles: Indices) -> Array:
    """Return the area of each triangle, (T,), in squared scene units."""
    return 0.5 * np.linalg.norm(area_vectors(vertices, triangles), axis=1)


def face_normals(vertices: Array, triangles: Indices) -> Array:
    """Return the unit normals of triangles, (T, 3), zero where one has no area."""
    return unit(area_vectors(vertices, triangles))


def normals_and_areas(vertices: Array, triangles: Indices) -> tuple[Array, Array]:
    """Return the unit normals, (T, 3), zero where a triangle has no area, and the areas, (T,)."""
    vectors = area_vectors(vertices, triangles)
    return unit(vectors), 0.5 * np.linalg.norm(vectors, axis=1)


def normals_around(normals: Array, triangles: Indices, vertex_count: int) -> Array:
    """Return the direction of the sum of the triangles' (weighted) normals at each vertex, (V, 3); zero where none."""
    sums = [np.bincount(triangles.ravel(), np.repeat(normals[:, axis], 3), vertex_count) for axis in range(3)]
    return unit(np.stack(sums, axis=1))


def angle_between(one: Array, other: Array) -> Array:
    """Return the angle between vectors (N, 3) in radians, (N,): by atan2, as arccos is inexact for small angles."""
    return np.arctan2(np.linalg.norm(np.cross(one, other), axis=1), (one * other).sum(axis=1))

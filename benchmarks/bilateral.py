"""The peer of denoising: a bilateral normal filter with one width, tuned on the clean mesh.

After Zheng, Fu, Au and Tai, "Bilateral normal filtering for mesh denoising" (TVCG 2011), local scheme, with the vertex
update of Sun, Rosin, Martin and Langbein (TVCG 2007).  It is given what no user has: of all the widths and numbers of
iterations below those that come closest to the clean mesh.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

WIDTHS = (0.2, 0.3, 0.35, 0.4, 0.5)
ITERATIONS = (3, 5, 10, 20)
UPDATES = 20


def filtered(vertices: Array, triangles: Indices) -> Iterator[Array]:
    """Yield the vertices, (V, 3), as filtered with each width and number of iterations."""
    around = _around(triangles, len(vertices))
    for width in WIDTHS:
        normals, area = _normals(vertices, triangles)
        centroids = vertices[triangles].mean(axis=1)
        distance = np.linalg.norm(centroids[around.row] - centroids[around.col], axis=1)
        weight = area[around.col] * np.exp(-(distance**2) / (2.0 * distance.mean() ** 2))
        for iteration in range(1, max(ITERATIONS) + 1):
            likeness = ((normals[around.row] - normals[around.col]) ** 2).sum(axis=1)
            each = weight * np.exp(-likeness / (2.0 * width**2))
            matrix = csr_array(coo_array((each, (around.row, around.col)), shape=around.shape))
            normals = _unit(area[:, None] * normals + matrix @ normals)
            if iteration in ITERATIONS:
                yield updated(vertices, triangles, normals)


def updated(vertices: Array, triangles: Indices, normals: Array) -> Array:
    """Move the vertices, (V, 3), towards planes with the given normals, (T, 3)."""
    moved = vertices.copy()
    count = np.maximum(np.bincount(triangles.ravel(), minlength=len(vertices)), 1)
    for _ in range(UPDATES):
        centroids = moved[triangles].mean(axis=1)
        total = np.zeros_like(moved)
        for corner in range(3):
            height = (normals * (centroids - moved[triangles[:, corner]])).sum(axis=1, keepdims=True)
            for axis in range(3):
                total[:, axis] += np.bincount(triangles[:, corner], (normals * height)[:, axis], len(vertices))
        moved += total / count[:, None]
    return moved


def _around(triangles: Indices, vertices: int) -> coo_array:
    """Pairs of triangles that share a vertex."""
    count = len(triangles)
    ones = np.ones(3 * count)
    holds = coo_array((ones, (np.repeat(np.arange(count), 3), triangles.ravel())), shape=(count, vertices)).tocsr()
    pairs = coo_array(holds @ holds.T)
    apart = pairs.row != pairs.col
    return coo_array((np.ones(int(apart.sum())), (pairs.row[apart], pairs.col[apart])), shape=pairs.shape)


def _normals(vertices: Array, triangles: Indices) -> tuple[Array, Array]:
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    crossed = np.asarray(np.cross(b - a, c - a), dtype=np.float64)
    return _unit(crossed), 0.5 * np.linalg.norm(crossed, axis=1)


def _unit(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0)

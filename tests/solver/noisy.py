"""Meshes with noise on them, and how far a denoised mesh is from the clean one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def halved(faces: Indices) -> Indices:
    """Return triangles as they are and quads cut along a diagonal."""
    return faces if faces.shape[1] == 3 else np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])


def face_normals(vertices: Array, triangles: Indices) -> Array:
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)


def diagonal(vertices: Array) -> float:
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


def with_noise(vertices: Array, faces: Indices, share: float, seed: int, *, isotropic: bool = False) -> Array:
    """Return vertices with Gaussian noise of `share` of the bounding box's diagonal, (V, 3).

    Along the vertex normals, or in all directions with the same root mean square length.
    """
    rng = np.random.default_rng(seed)
    level = share * diagonal(vertices)
    if isotropic:
        return vertices + rng.normal(0.0, level / np.sqrt(3.0), vertices.shape)
    triangles = halved(faces)
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    normals = np.zeros_like(vertices)
    np.add.at(normals, triangles.ravel(), np.repeat(np.cross(b - a, c - a), 3, axis=0))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return vertices + normals * rng.normal(0.0, level, len(vertices))[:, None]


def distance_from_clean(clean: Array, faces: Indices, vertices: Array) -> tuple[float, float]:
    """Return the rms distance of the vertices in longest sides, and the mean angle of the face normals in degrees."""
    rms = np.sqrt(np.mean(np.sum((vertices - clean) ** 2, axis=1))) / np.ptp(clean, axis=0).max()
    triangles = halved(faces)
    cosine = np.sum(face_normals(clean, triangles) * face_normals(vertices, triangles), axis=1)
    return float(rms), float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).mean())

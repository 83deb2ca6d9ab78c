"""Bilateral filtering of triangle normals: the guide that tells one side of a crease from the other.

After Zheng, Fu, Au and Tai, "Bilateral normal filtering for mesh denoising" (TVCG 2011), with a width for each pair of
triangles: what the noise makes of their normals.  One width for all would let the noise of small triangles through or
round off the creases between large ones.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ..arrays import Array
from ..mesh.normals import normals_and_areas, unit
from .surface import Surface

_ITERATIONS = 3
_WIDTH = 1.2  # of the deviation that the noise gives the difference of two normals
_NARROWER = 0.85  # each iteration leaves less noise in the normals
_WIDEST = 0.9
_NARROWEST = 0.1


def filter_normals(surface: Surface, vertices: Array, noise_level: float) -> Array:
    """Return the triangles' normals, (T, 3), smoothed within the sides of creases.

    Parameters
    ----------
    surface, vertices
        The mesh; positions (V, 3).
    noise_level
        Standard deviation of the noise along the normals, in scene units.
    """
    normals, areas = normals_and_areas(vertices, surface.triangles)
    weight = np.sqrt(areas / max(float(areas.mean()), 1e-300))
    around = surface.around
    one = np.repeat(np.arange(len(normals)), np.diff(around.indptr))
    two = around.indices
    nearness = _nearness(vertices, surface, one, two) * weight[two]
    width = _WIDTH * _normal_deviation(surface, vertices, areas, noise_level)
    width = np.clip(np.sqrt(width[one] ** 2 + width[two] ** 2), _NARROWEST, _WIDEST)
    for iteration in range(_ITERATIONS):
        difference = ((normals[one] - normals[two]) ** 2).sum(axis=1)
        likeness = np.exp(-difference / (2 * (width * _NARROWER**iteration) ** 2))
        weights = csr_array((nearness * likeness, two, around.indptr), shape=around.shape)
        normals = unit(normals * weight[:, None] + weights @ normals)
    return normals


def smooth_normals(surface: Surface, vertices: Array, rounds: int = 2) -> Array:
    """Return the triangles' normals, (T, 3), averaged some times with those around, weighted with the areas."""
    normals, areas = normals_and_areas(vertices, surface.triangles)
    around = surface.around.astype(np.float64)
    for _ in range(rounds):
        weighted = normals * areas[:, None]
        normals = unit(weighted + around @ weighted)
    return normals


def _nearness(vertices: Array, surface: Surface, one: NDArray[np.integer[Any]], two: NDArray[np.integer[Any]]) -> Array:
    """Gaussian of the distance of two triangles' centroids, its width the mean distance around each."""
    centroids = vertices[surface.triangles].mean(axis=1)
    distance = np.linalg.norm(centroids[one] - centroids[two], axis=1)
    mean = np.bincount(one, distance, len(centroids)) / np.maximum(np.diff(surface.around.indptr), 1)
    return np.exp(-(distance**2) / np.maximum(2 * mean[one] * mean[two], 1e-300))


def _normal_deviation(surface: Surface, vertices: Array, areas: Array, noise_level: float) -> Array:
    """Deviation, (T,), that the noise of its corners gives a triangle's normal, the geometric mean around it.

    A triangle turns by the noise at a corner over the height there: its variance is the sum of the squared inverse
    heights, sum(l^2) / (2 A)^2.
    """
    corners = vertices[surface.triangles]
    squared_sides = ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=(1, 2))
    inverse = np.log(np.maximum(squared_sides, 1e-300)) - 2 * np.log(np.maximum(2 * areas, 1e-300))
    proper = (areas > 0).astype(np.float64)
    around = surface.around.astype(np.float64)
    mean = (inverse * proper + around @ (inverse * proper)) / np.maximum(proper + around @ proper, 1)
    return noise_level * np.exp(np.clip(0.5 * mean, -300, 300))

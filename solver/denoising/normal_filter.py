"""Bilateral filtering of triangle normals: the guide that tells one side of a crease from the other.

After Zheng, Fu, Au and Tai, "Bilateral normal filtering for mesh denoising" (TVCG 2011), with a width for each pair of
triangles: what the noise makes of their normals.  One width for all would let the noise of small triangles through or
round off the creases between large ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ..arrays import Array, runs_of_rows
from ..mesh.normals import normals_and_areas, unit
from .surface import Surface

_ITERATIONS = 3
_WIDTH = 1.2  # of the deviation that the noise gives the difference of two normals
_NARROWER = 0.85  # each iteration leaves less noise in the normals
_WIDEST = 0.9
_NARROWEST = 0.1
_TILT = np.sqrt(2.0)  # along a tangent: noise of one edge's length tilts equilateral triangles by that
_NEARLY_ALL = 3.0  # medians of lengths in two directions: Gaussian ones are longer twice in a thousand
_PAIRS = 1 << 18  # of triangles that are worked on together


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
    width = (_WIDTH * _normal_deviation(surface, vertices, areas, noise_level)) ** 2
    blocks = list(_blocks(surface.around))
    nearness = _nearness(vertices, surface, blocks)
    for block, near in zip(blocks, nearness, strict=True):
        near *= weight[block.two]
    for iteration in range(_ITERATIONS):
        filtered = normals * weight[:, None]
        for block, near in zip(blocks, nearness, strict=True):
            one = block.one
            wide = np.clip(np.sqrt(width[one] + width[block.two]), _NARROWEST, _WIDEST) * _NARROWER**iteration
            difference = ((normals[one] - normals[block.two]) ** 2).sum(axis=1)
            weights = near * np.exp(-difference / (2 * wide**2))
            filtered[block.rows] += block.matrix(weights, len(normals)) @ normals
        normals = unit(filtered)
    return normals


@dataclass(frozen=True)
class _Block:
    """Pairs of a run of triangles with those around them: what is computed for each pair would fill the memory.

    Attributes
    ----------
    rows
        The run.
    offsets
        Where the pairs of each triangle of the run start and end, (n + 1,).
    two
        Second triangle of each pair.
    """

    rows: slice
    offsets: NDArray[np.integer[Any]]
    two: NDArray[np.integer[Any]]

    @property
    def one(self) -> NDArray[np.integer[Any]]:
        """First triangle of each pair."""
        return np.repeat(np.arange(self.rows.start, self.rows.stop, dtype=self.two.dtype), np.diff(self.offsets))

    def matrix(self, weights: Array, columns: int) -> csr_array:
        """Return the weights of the pairs as a matrix, a row a triangle of the run."""
        return csr_array((weights, self.two, self.offsets), shape=(len(self.offsets) - 1, columns))


def _blocks(around: csr_array) -> Iterator[_Block]:
    for start, end in runs_of_rows(around.indptr, _PAIRS):
        offsets = around.indptr[start : end + 1]
        yield _Block(slice(start, end), offsets - offsets[0], around.indices[offsets[0] : offsets[-1]])


def smooth_normals(surface: Surface, vertices: Array, rounds: int = 2) -> Array:
    """Return the triangles' normals, (T, 3), averaged some times with those around, weighted with the areas."""
    normals, areas = normals_and_areas(vertices, surface.triangles)
    around = surface.around.astype(np.float64)
    for _ in range(rounds):
        weighted = normals * areas[:, None]
        normals = unit(weighted + around @ weighted)
    return normals


def guide_deviation(surface: Surface, normals: Array, noise: float) -> float:
    """Return how far a guide's normals, (T, 3), may be off along a tangent, for noise over the mean edge length.

    At most as far as the noise tilts a regular triangle; and where the shape bends from triangle to triangle otherwise
    than a quadratic does, as far as nearly all differ from the mean of those around.
    """
    apart = np.linalg.norm(unit(surface.around.astype(np.float64) @ normals) - normals, axis=1)
    return float(np.hypot(_TILT * noise, _NEARLY_ALL * np.median(apart)))


def _nearness(vertices: Array, surface: Surface, blocks: Sequence[_Block]) -> list[Array]:
    """Gaussian of the distance of two triangles' centroids, its width the mean distance around each; for each block."""
    centroids = vertices[surface.triangles].mean(axis=1)
    mean = np.zeros(len(centroids))
    nearness = []
    for block in blocks:
        one, sizes = block.one, np.diff(block.offsets)
        distance = np.linalg.norm(centroids[one] - centroids[block.two], axis=1)
        mean[block.rows] = np.bincount(one - block.rows.start, distance, len(sizes)) / np.maximum(sizes, 1)
        nearness.append(distance)
    for block, distance in zip(blocks, nearness, strict=True):
        distance[:] = np.exp(-(distance**2) / np.maximum(2 * mean[block.one] * mean[block.two], 1e-300))
    return nearness


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

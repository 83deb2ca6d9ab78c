"""One-sided patches: quadratics over tangent planes, fitted robustly to the noisy positions on one side of a crease.

Each patch starts small and doubles while the larger fit moves the smaller one's surface by no more than the noise
does (in the spirit of Lepski's rule): flat sides are averaged over hundreds of triangles, fine relief over a dozen.
Triangles whose guiding normal the quadratic does not follow and vertices far off it lose their weight (Welsch), so
what leaks over a crease does not count.  Curvature that noise alone could have made is shrunk (James and Stein), which
turns the patches of a plane into planes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .patch_growth import Agreement, Claims, GrowingPatches, chunk_size
from .surface import Surface, unit

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]

TERMS = 6  # 1, u, v, u^2, u v, v^2
FEWEST_VERTICES = 8  # with fewer, or with less weight than that of so many, a quadratic says nothing

_PASSES = 2
_RESIDUAL_WIDTH = 2.0  # noise levels
_RIM_TAPER = 0.7  # how much less a vertex at the rim weighs than one at the seed
_RIDGE = 1e-4
_SHRINKAGE = 1.0  # k - 2 for the k = 3 curvature terms
_INVARIANT = np.array([1.0, 1.0, 1.0, 1.0, 0.5, 1.0])  # a ridge that does not depend on the directions of u and v


@dataclass(frozen=True)
class PatchRule:
    """How patches are grown and weighted.

    Attributes
    ----------
    sizes
        Numbers of triangles, ascending: how large a patch is at most at each step of its growth.
    normal_width
        Distance of the guiding normal from the quadratic's at which a triangle's weight has fallen to exp(-1/2).
    largest_change
        How far a step of growth may move the smaller patch's surface: the squared moves of its vertices add up to
        at most this many squared noise levels.
    misfit_power
        How strongly a patch loses weight whose residuals are larger than the noise.
    """

    sizes: tuple[int, ...]
    normal_width: float
    largest_change: float
    misfit_power: float

    @property
    def agreement(self) -> Agreement:
        """Which triangles join a patch."""
        across = np.clip(2.5 * self.normal_width, 0.35, 1.2)
        from_seed = max(2.5 * self.normal_width, 0.7)
        return Agreement(float(np.cos(across)), float(np.cos(from_seed)))


@dataclass(frozen=True)
class Fits:
    """Fitted patches, P of them, padded to the largest: K triangles, L vertices; -1 marks padding.

    Attributes
    ----------
    seeds
        Triangles that the patches started from, (P,).
    triangles, vertices
        Members, (P, K) and (P, L).
    frames
        Columns: two tangents and the normal of the seed, (P, 3, 3).
    coefficients
        Of 1, u, v, u^2, u v, v^2 for the height, (P, 6); u and v in units of the seed's size.
    gram
        Weighted products of the terms, (P, 6, 6).
    variance
        Covariance of the coefficients for noise of variance 1, (P, 6, 6).
    vertex_weights
        Weights in [0, 1], (P, L), zero on padding.
    triangle_weights
        How well the quadratic follows the guiding normals, (P, K), zero on padding.
    vertex_terms, triangle_terms
        The terms at vertices and centroids, (P, L, 6) and (P, K, 6).
    vertex_normals, triangle_normals
        The quadratic's normals there in space, (P, L, 3) and (P, K, 3).
    offsets
        Signed distance along the normal from each vertex to the quadratic, (P, L).
    misfit
        Mean squared residual over that of the noise, (P,).
    sound
        Patches with enough vertices to say something, (P,).
    """

    seeds: Integers
    triangles: Integers
    vertices: Integers
    frames: Floats
    coefficients: Floats
    gram: Floats
    variance: Floats
    vertex_weights: Floats
    triangle_weights: Floats
    vertex_terms: Floats
    triangle_terms: Floats
    vertex_normals: Floats
    triangle_normals: Floats
    offsets: Floats
    misfit: Floats
    sound: Booleans

    def select(self, which: Booleans) -> Fits:
        """Return some of the patches."""
        return Fits(**{item.name: getattr(self, item.name)[which] for item in fields(self)})

    def __len__(self) -> int:
        return len(self.seeds)


class PatchFitter:
    """Grows and fits patches on one mesh with one set of guiding normals.

    Parameters
    ----------
    surface, vertices
        The mesh; noisy positions (V, 3).
    guide
        Guiding normals of the triangles, (T, 3).
    noise_level
        Standard deviation of the noise along the normals.
    rule
        How patches grow.
    """

    def __init__(self, surface: Surface, vertices: Floats, guide: Floats, noise_level: float, rule: PatchRule) -> None:
        self.chunk = chunk_size(max(len(surface.triangles), len(vertices)))
        self._surface, self._vertices, self._guide = surface, vertices, guide
        self._noise_level, self._rule = noise_level, rule
        corners = vertices[surface.triangles]
        self._centroids = corners.mean(axis=1)
        self._unit_length = 3 * np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean(axis=1)
        self._triangle_claims = Claims(self.chunk, len(surface.triangles))
        self._vertex_claims = Claims(self.chunk, len(vertices))

    def fits(self, seeds: Integers) -> Iterator[Fits]:
        """Yield the patches of at most `chunk` seeds, each at the largest size that the rule lets it have."""
        growing = GrowingPatches(
            self._surface.neighbours, self._guide, seeds, self._rule.agreement, self._triangle_claims
        )
        active = np.ones(len(seeds), dtype=bool)
        smaller: Fits | None = None
        before = growing.sizes.copy()
        for limit in self._rule.sizes:
            growing.grow(limit, active)
            larger = self._fit(seeds, active, growing)
            if smaller is not None:
                better = self._may_replace(smaller, larger) & (growing.sizes > before)[active]
                yield smaller.select(~better)
                larger = larger.select(better)
                active[active] = better
            smaller, before = larger, growing.sizes.copy()
            if not active.any():
                break
        if smaller is not None and len(smaller):
            yield smaller
        self._triangle_claims.clear()

    def _may_replace(self, smaller: Fits, larger: Fits) -> Booleans:
        change = larger.coefficients - smaller.coefficients
        moved = np.einsum("pi,pij,pj->p", change, smaller.gram, change) / self._noise_level**2
        return (moved < self._rule.largest_change) | ~smaller.sound

    def _fit(self, seeds: Integers, active: Booleans, growing: GrowingPatches) -> Fits:
        rows, members = growing.members(active)
        rows = (np.cumsum(active) - 1)[rows]
        seeds = seeds[active]
        triangles, slots = _padded(rows, members, len(seeds))
        vertices, corner_slots = self._vertices_of(rows, members, len(seeds))
        frames = _frames(self._guide[seeds])
        length = self._unit_length[seeds]
        at_vertex, height = self._local(vertices, self._vertices, seeds, frames, length)
        at_triangle, _ = self._local(triangles, self._centroids, seeds, frames, length)
        guide = self._guide[triangles] @ frames
        present = (vertices >= 0).astype(np.float64)
        vertex_terms = _terms(at_vertex) * present[..., None]
        extent = _mean(at_vertex, present)
        rim = np.where(present > 0, (at_vertex**2).sum(axis=2), 0.0)
        taper = present * (1 - _RIM_TAPER * rim / np.maximum(rim.max(axis=1), 1e-300)[:, None])
        ridge = _RIDGE * _INVARIANT * np.stack([1e-2 + 0 * extent, extent, extent] + 3 * [extent**2], axis=1)
        like = _welsch((guide - np.array([0.0, 0.0, 1.0])) ** 2, max(0.35, 1.5 * self._rule.normal_width))
        weights = taper
        for last in [False] * (_PASSES - 1) + [True]:
            pooled = np.bincount(corner_slots, np.repeat(like[rows, slots], 3), vertices.size).reshape(vertices.shape)
            weights = weights * pooled / np.maximum(pooled.max(axis=1, keepdims=True), 1e-300)
            gram, regular, variance, coefficients = _solve(vertex_terms, weights, height, ridge)
            if last:
                coefficients = _shrink_curvature(coefficients, regular, variance * self._noise_level**2)
            residual = height - (vertex_terms @ coefficients[..., None])[..., 0]
            triangle_normals = _normals(at_triangle, coefficients, length)
            like = _welsch((triangle_normals - guide) ** 2, self._rule.normal_width) * (triangles >= 0)
            if not last:
                weights = taper * _welsch((residual**2)[..., None], _RESIDUAL_WIDTH * self._noise_level)
        normals = _normals(at_vertex, coefficients, length)
        total = weights.sum(axis=1)
        effective = total**2 / np.maximum((weights**2).sum(axis=1), 1e-300)
        spread = (weights * residual**2).sum(axis=1) / np.maximum(total, 1e-300)
        spread /= np.maximum(1 - TERMS / np.maximum(effective, TERMS + 1), 1e-300) * self._noise_level**2
        return Fits(
            seeds=seeds,
            triangles=triangles,
            vertices=vertices,
            frames=frames,
            coefficients=coefficients,
            gram=gram,
            variance=variance,
            vertex_weights=weights,
            triangle_weights=like,
            vertex_terms=vertex_terms,
            triangle_terms=_terms(at_triangle),
            vertex_normals=normals @ frames.transpose(0, 2, 1),
            triangle_normals=triangle_normals @ frames.transpose(0, 2, 1),
            offsets=-residual * normals[..., 2],
            misfit=spread,
            sound=effective >= FEWEST_VERTICES,
        )

    def _vertices_of(self, rows: Integers, triangles: Integers, count: int) -> tuple[Integers, Integers]:
        """Return the patches' vertices, padded (P, L), and where in it (flattened) each triangle corner stands."""
        corner_rows = np.repeat(rows, 3)
        corners = self._surface.triangles[triangles].ravel()
        one = self._vertex_claims.claim(corner_rows, corners)
        one = one[np.argsort(corner_rows[one], kind="stable")]
        vertices, slots = _padded(corner_rows[one], corners[one], count)
        self._vertex_claims.number(corner_rows[one], corners[one], slots)
        corner_slots = corner_rows * vertices.shape[1] + self._vertex_claims.numbers(corner_rows, corners)
        self._vertex_claims.clear()
        return vertices, corner_slots

    def _local(
        self, members: Integers, positions: Floats, seeds: Integers, frames: Floats, length: Floats
    ) -> tuple[Floats, Floats]:
        """Return (u, v), (P, N, 2), and heights, (P, N), of the members in their patches' frames."""
        local = (positions[members] - self._centroids[seeds][:, None]) @ frames
        return local[..., :2] / np.maximum(length, 1e-300)[:, None, None], local[..., 2]


def _padded(rows: Integers, members: Integers, count: int) -> tuple[Integers, Integers]:
    """Return ragged members, sorted by row, as (count, K) padded with -1, and the column of each."""
    sizes = np.bincount(rows, minlength=count)
    columns = np.arange(len(rows)) - (np.cumsum(sizes) - sizes)[rows]
    padded = np.full((count, int(sizes.max(initial=0))), -1, dtype=np.int64)
    padded[rows, columns] = members
    return padded, columns


def _frames(normals: Floats) -> Floats:
    """Return matrices whose columns are two tangents and the normal, (P, 3, 3)."""
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = unit(np.cross(normals, axis))
    return np.stack((first, np.cross(normals, first), normals), axis=2)


def _terms(at: Floats) -> Floats:
    u, v = at[..., 0], at[..., 1]
    return np.stack((np.ones_like(u), u, v, u * u, u * v, v * v), axis=-1)


def _mean(at: Floats, present: Floats) -> Floats:
    """Mean square distance from the seed, per axis."""
    return ((at**2).sum(axis=2) * present).sum(axis=1) / np.maximum(2 * present.sum(axis=1), 1)


def _welsch(squares: NDArray[Any], width: float) -> Floats:
    return np.exp(-squares.sum(axis=-1) / (2 * width**2))


def _solve(terms: Floats, weights: Floats, height: Floats, ridge: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Weighted least squares; return Gram matrices without and with the ridge, covariances and coefficients."""
    weighted = (terms * weights[..., None]).transpose(0, 2, 1)
    gram: Floats = weighted @ terms
    regular: Floats = gram + (ridge * np.maximum(weights.sum(axis=1), 1e-6)[:, None])[:, :, None] * np.eye(TERMS)
    inverse: Floats = np.linalg.inv(regular)
    variance: Floats = inverse @ (weighted @ weighted.transpose(0, 2, 1)) @ inverse
    coefficients = (inverse @ (weighted @ height[..., None]))[..., 0]
    return gram, regular, variance, coefficients


def _shrink_curvature(coefficients: Floats, gram: Floats, covariance: Floats) -> Floats:
    """Shrink the second-order terms by what noise alone explains of them; refit the others to that."""
    curvature = coefficients[:, 3:]
    explained = np.linalg.solve(covariance[:, 3:, 3:] + 1e-300 * np.eye(3), curvature[..., None])[..., 0]
    significance = (curvature * explained).sum(axis=1)
    kept = np.maximum(0.0, 1 - _SHRINKAGE / np.maximum(significance, 1e-300))
    change = (kept - 1)[:, None] * curvature
    others = np.linalg.solve(gram[:, :3, :3], gram[:, :3, 3:] @ change[..., None])[..., 0]
    return coefficients + np.concatenate((-others, change), axis=1)


def _normals(at: Floats, coefficients: Floats, length: Floats) -> Floats:
    """Return the quadratics' unit normals at (u, v), in their frames, (P, N, 3)."""
    u, v = at[..., 0], at[..., 1]
    c = coefficients[:, None, :] / np.maximum(length, 1e-300)[:, None, None]
    slope_u = c[..., 1] + 2 * c[..., 3] * u + c[..., 4] * v
    slope_v = c[..., 2] + 2 * c[..., 5] * v + c[..., 4] * u
    return unit(np.stack((-slope_u, -slope_v, np.ones_like(u)), axis=-1))

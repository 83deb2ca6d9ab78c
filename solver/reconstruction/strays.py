"""Stray points of a cloud: isolated, and off the surface that the points around them show.

A point is compared with the densest of its neighbours, and is stray where it lies much sparser than these and off their
planes.  Of two scans one may be sparser, and at a border or a corner neighbours are fewer: such points lie on a surface
of their neighbours, so they stay.  Strays far from the surface have only each other for neighbours; these show no
surface at all.  What is left is looked at again until no more are found.  This is the local outlier factor (Breunig et
al. 2000), with the distance from the surface as a second witness.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array, Booleans, Indices, row_blocks, rows_at, sum_of
from ..mesh.quadrics import quadric_terms
from .geometry import local_planes, neighbours

NEIGHBOURS, RANK, PLANE = 24, 8, 12
"""Points among which the densest are sought, rank of the neighbour whose distance is a point's radius, and points,
itself included, through which a plane is laid."""

DENSEST, PLANES = 5, 8
"""Neighbours that say how dense the surface is here, and those whose planes count."""

SPARSER, OFF_PLANES, NOISE_LEVELS = 2.0, 0.25, 4.0
"""A stray point's radius is larger than theirs by the first factor.  It is off the planes by the second share of its
radius, and by the third multiple of how far points here deviate from planes."""

DENSER = 1.3
"""Only planes of points that lie denser by this factor are asked; the second nearest of them counts."""

MUCH_SPARSER, OFF_MOST_PLANES = 4.0, 0.3
"""The same for a point so far away that planes of noise, which point anywhere, may meet it: half of them must not."""

ALONE = 4.0
"""A point is stray, too, where its radius is larger than its neighbours' by this factor."""

ROUGH = 0.15
"""Points much sparser than the whole cloud show no surface where they deviate from a quadric by more than this share of
the farthest one's distance."""

SMOOTH, ON_QUADRIC = 0.1, 0.06
"""A point stays where its neighbours deviate less than this from their quadric, and itself less than that."""

BESIDE, FLAT, ON_PLANE, AGREEING = 1.3, 0.06, 0.12, 3
"""It stays, too, where this many neighbours, no farther than this multiple of their radius, have points so close to
their planes and itself so close, in shares of their radius: at an edge no quadric fits."""

ROUNDS = 10

FEWEST_POINTS = 50
"""Fewer points show no density."""


def stray_points(points: Array) -> Booleans:
    """Find the strays of a cloud of distinct points, (P, 3); returns (P,)."""
    left = np.arange(len(points))
    for _ in range(ROUNDS):
        if len(left) < FEWEST_POINTS:
            break
        stray = _Neighbourhoods.of(points[left]).strays()
        if not stray.any():
            break
        left = left[~stray]
    result = np.ones(len(points), dtype=bool)
    result[left] = False
    return result


@dataclass(frozen=True)
class _Neighbourhoods:
    """The neighbours of each point.

    Attributes
    ----------
    points
        (P, 3).
    near, distance
        Numbers of the nearest points, itself first, and how far they are, (P, k).
    radius
        Distance of the eighth, (P,).
    normals, variance, centres
        Planes through the nearest, and the mean squared distances from them.
    """

    points: Array
    near: Indices
    distance: Array
    radius: Array
    normals: Array
    variance: Array
    centres: Array

    @classmethod
    def of(cls, points: Array) -> _Neighbourhoods:
        distance, near = neighbours(cKDTree(points), NEIGHBOURS)
        radius = np.maximum(distance[:, RANK], 1e-300)
        return cls(points, near, distance, radius, *local_planes(points, near[:, :PLANE]))

    def strays(self) -> Booleans:
        """Which points are stray beside the others, (P,)."""
        suspect = self._off_the_densest()
        sparse = self.radius > MUCH_SPARSER * np.median(self.radius)
        asked = np.flatnonzero(suspect | sparse)
        if not len(asked):
            return suspect
        own, rough = _off_quadric(self.points[asked], self.points[self.near[asked, 1:]])
        own, rough = own / self.distance[asked, -1], rough / self.distance[asked, -1]
        stays = ((rough < SMOOTH) & (own < ON_QUADRIC)) | self._on_planes(asked, suspect)
        suspect[asked] &= ~stays
        suspect[asked] |= sparse[asked] & (rough > ROUGH)
        return suspect

    def _off_the_densest(self) -> Booleans:
        radius = self.radius
        by_density = np.argsort(radius[self.near], axis=1, kind="stable")[:, :PLANES]
        densest = np.take_along_axis(self.near, by_density, axis=1)
        sparser = radius / np.median(radius[densest[:, :DENSEST]], axis=1)
        off = self._off_planes(np.arange(len(radius)), densest)
        far = (sparser > MUCH_SPARSER) & (np.median(off, axis=1) > OFF_MOST_PLANES * radius)
        off = np.sort(np.where(radius[densest] * DENSER < radius[:, None], off, np.inf), axis=1)[:, 1]
        off = np.where(np.isfinite(off), off, 0.0)
        noise = np.sqrt(np.median(self.variance[densest], axis=1))
        near = (sparser > SPARSER) & (off > OFF_PLANES * radius) & (off > NOISE_LEVELS * noise)
        alone = radius > ALONE * np.median(radius[self.near[:, 1 : RANK + 1]], axis=1)
        return np.asarray(near | far | alone, dtype=np.bool_)

    def _on_planes(self, asked: Indices, suspect: Booleans) -> Booleans:
        """Which of the points lie on the planes of neighbours that are not suspect themselves."""
        beside = self.near[asked, 1 : PLANE + 1]
        radius = self.radius[beside]
        agrees = (self.distance[asked, 1 : PLANE + 1] < BESIDE * radius) & ~suspect[beside]
        agrees &= np.sqrt(self.variance[beside]) < FLAT * radius
        agrees &= self._off_planes(asked, beside) < ON_PLANE * radius
        return np.asarray(agrees.sum(axis=1) >= AGREEING, dtype=np.bool_)

    def _off_planes(self, which: Indices, others: Indices) -> Array:
        """How far points are from the planes of others each, (N, n)."""
        off = np.empty(others.shape)
        for rows in row_blocks(len(which)):
            own = others[rows]
            offset = self.points[which[rows], None] - rows_at(self.centres, own)
            off[rows] = np.abs(sum_of(offset * rows_at(self.normals, own)))
        return off


def _off_quadric(points: Array, others: Array) -> tuple[Array, Array]:
    """How far points (N, 3) are off the quadrics through n > 6 others each, (N, n, 3), and how far these deviate."""
    middle = others.mean(axis=1, keepdims=True)
    centred = others - middle
    _, axes = np.linalg.eigh(np.matmul(centred.swapaxes(1, 2), centred))
    local = np.matmul(np.concatenate([points[:, None] - middle, centred], axis=1), axes[:, :, ::-1])
    size = np.maximum(np.abs(local[..., :2]).max(axis=(1, 2)), 1e-300)
    u, v = np.moveaxis(local[..., :2] / size[:, None, None], 2, 0)
    terms, height = quadric_terms(u, v, 2), local[..., 2:]
    q, r = np.linalg.qr(terms[:, 1:])
    coefficients = np.linalg.solve(r + 1e-12 * np.eye(r.shape[1]), np.matmul(q.swapaxes(1, 2), height[:, 1:]))
    left = (height - np.matmul(terms, coefficients))[:, :, 0]
    return np.abs(left[:, 0]), np.sqrt((left[:, 1:] ** 2).sum(axis=1) / (others.shape[1] - 6))

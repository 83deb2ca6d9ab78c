"""What a point cloud reveals of its surface before anything is fitted: density, noise, normals, creases.

Everything is computed from each point's nearest neighbours.  At a crease the neighbourhood of a point extends to the
other side, which tilts its plane of least squares.  So each point takes the plane of the neighbour whose own
neighbourhood is the flattest (the filter of Kuwahara et al. 1976, on normals), which is on the point's side.  Where
neighbours then disagree there is a crease, and it lies where their planes meet: the least squares of the distances from
them all (Garland, Heckbert 1997; Ju et al. 2002).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array, Indices, row_blocks, rows_at, sum_of
from ..mesh.clustering import one_in_each_cell
from ..mesh.quadrics import quadric_terms
from .two_sides import apart

NEIGHBOURS = 16
"""Points in a neighbourhood, with the point itself."""

PLANES_TO_CHOOSE_FROM = 13
"""Nearest points, with the point itself, whose planes a point may take over."""

NOISE_NEIGHBOURS, NOISE_SAMPLES = 24, 4000
"""Points in a neighbourhood, and the most neighbourhoods, from which noise is estimated."""

NOISE_QUANTILE, NOISE_AT_QUANTILE = 0.25, 0.8717
"""Up to three quarters of the neighbourhoods may extend over creases.  The second is the root of that quantile of chi
squared / n for n = 18."""

NORMAL_QUANTILE = 0.6744897501960817
"""The same quantile of the normal distribution, its sign turned."""

WIDE_NOISE, MOST_NEIGHBOURS, FEWEST_SAMPLES = 0.2, 400, 1000
"""Noise above this share of the neighbourhood's radius asks for twice the neighbours, up to that many; fewer
neighbourhoods are then enough, but not fewer than the last."""

SHARPEST = np.cos(np.radians(35.0))
"""Normals that differ by more than this angle belong to two sides of a crease."""

FEWEST_ON_A_SIDE = 3
"""Neighbours that a side of a crease must have."""

FLAT = 0.05
"""Planes do not fix a crease point along directions with less than this share of the largest eigenvalue."""

BENT = 0.03
"""At a crease a neighbourhood deviates from a quadric by at least this share of the spacing; a smooth bend that few
points resolve, like that of a small sphere, does not."""

LONGEST_MOVE = 1.6
"""Spacings that a point may lie from its crease."""

MOST_OFF_PLANES = 0.15
"""Spacings that a crease point may be off the planes that meet there, beside the noise."""

SPARSEST = 3.0
"""A point that is this many times farther from its neighbours than usual gives no crease point."""

POINTS_AT_ONCE = 2_000_000
"""Points of neighbourhoods that are held in memory together."""

NOISIEST = 0.5
"""With noise above this share of the spacing creases are not sought."""


@dataclass(frozen=True)
class CloudGeometry:
    """Local geometry of a point cloud.

    Attributes
    ----------
    spacing
        Typical distance between neighbouring points.
    noise
        Standard deviation of the points from a smooth surface, across it.
    normals
        Unit normals of arbitrary sign, (P, 3); one-sided at creases.
    creases
        Points on sharp edges and corners, about as dense as the cloud, (C, 3).
    """

    spacing: float
    noise: float
    normals: Array
    creases: Array


def analyse(points: Array, outward: Array | None = None) -> CloudGeometry:
    """Analyse a cloud of at least four points, (P, 3), whose thin parts `outward_normals`, (P, 3), may tell apart."""
    tree, count = cKDTree(points), min(NEIGHBOURS, len(points))
    distance, near = neighbours(tree, count)
    spacing, places, beside = typical_spacing(distance), points, near
    if outward is not None:
        places = apart(points, outward, spacing)
        tree = cKDTree(places)
        separate, beside = neighbours(tree, count)
        spacing = typical_spacing(separate)
    noise = noise_level(points, tree, places)
    normals = one_sided_normals(points, beside)
    creases = np.zeros((0, 3))
    if noise <= NOISIEST * spacing:
        creases = crease_points(points, normals, near, distance, spacing, noise)
    return CloudGeometry(spacing, noise, normals, creases)


def neighbours(tree: cKDTree, count: int) -> tuple[Array, Indices]:
    """How far the `count` > 1 points nearest to each of a tree's are, itself first, and their numbers, (P, count) both.

    They are sought in the order of the tree: what a query needs is then still in the cache from the one before it.
    """
    order = tree.indices
    distance, near = np.empty((len(order), count)), np.empty((len(order), count), dtype=np.int64)
    for rows in row_blocks(len(order)):
        own = order[rows]
        distance[own], near[own] = tree.query(tree.data[own], k=count)
    return distance, near


def typical_spacing(distance: Array) -> float:
    """Median side of the square that a point has to itself, from sorted distances to its neighbours, (P, k)."""
    return float(np.median(spacings(distance)))


def spacings(distance: Array) -> Array:
    """Side of the square that each point has to itself, from sorted distances to its neighbours, (P, k)."""
    rank = min(8, distance.shape[1] - 1)
    sides: Array = distance[:, rank] * np.sqrt(np.pi / rank)
    return sides


def noise_level(points: Array, tree: cKDTree, places: Array) -> float:
    """Standard deviation of points from quadrics fitted to their neighbours: a low quantile over the cloud.

    A surface that bends more within a neighbourhood than a quadric counts as noise: the points do not resolve it.
    Noise as wide as the neighbourhood fills it evenly and is underestimated, so the neighbourhood grows with the noise.
    """
    count = min(NOISE_NEIGHBOURS, len(points))
    if count < 10:
        return 0.0
    asked = np.unique(np.linspace(0, len(points) - 1, min(NOISE_SAMPLES, len(points))).astype(np.int64))
    while True:
        distance, near = tree.query(places[asked], k=count)
        deviation = deviation_from_quadric(points[near])
        freedom = count - 6
        share = NOISE_AT_QUANTILE if freedom == 18 else _chi_quantile(freedom)
        noise = float(np.quantile(deviation, NOISE_QUANTILE)) / share
        if noise < WIDE_NOISE * np.median(distance[:, -1]) or 2 * count > min(MOST_NEIGHBOURS, len(points)):
            return noise
        count *= 2
        asked = asked[:: 2 if len(asked) > FEWEST_SAMPLES else 1]


def _chi_quantile(freedom: int) -> float:
    """Root of the quantile of chi squared / n (Wilson, Hilferty 1931)."""
    spread = 2.0 / (9.0 * freedom)
    return float((1.0 - spread - NORMAL_QUANTILE * np.sqrt(spread)) ** 1.5)


def deviation_from_quadric(near: Array) -> Array:
    """Standard deviation of neighbourhoods (N, n, 3), n > 6, from the quadrics of least squares through them, (N,)."""
    centred = near - near.mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.matmul(centred.swapaxes(1, 2), centred))
    local = np.matmul(centred, axes[:, :, ::-1])
    size = np.abs(local[..., :2]).max(axis=(1, 2), initial=0.0)
    u, v = np.moveaxis(local[..., :2] / np.where(size > 0.0, size, 1.0)[:, None, None], 2, 0)
    basis, _ = np.linalg.qr(quadric_terms(u, v, 2))
    height = local[..., 2]
    left = height - np.matmul(basis, np.matmul(basis.swapaxes(1, 2), height[:, :, None]))[:, :, 0]
    deviation: Array = np.sqrt((left**2).sum(axis=1) / (near.shape[1] - 6))
    return deviation


def one_sided_normals(points: Array, near: Indices) -> Array:
    """Normals (P, 3), each from the flattest neighbourhood that a point is in the middle of."""
    normals, flatness, centres = local_planes(points, near)
    rivals = near[:, : min(PLANES_TO_CHOOSE_FROM, near.shape[1])]
    chosen = np.empty_like(normals)
    for rows in row_blocks(len(points)):
        own = rivals[rows]
        off = sum_of((points[rows, None] - rows_at(centres, own)) * rows_at(normals, own))
        best = (flatness[own] + off**2).argmin(axis=1)
        chosen[rows] = normals[own[np.arange(len(own)), best]]
    return chosen


def local_planes(points: Array, near: Indices) -> tuple[Array, Array, Array]:
    """Planes of least squares through the neighbours: normals (P, 3), mean squared distances (P,), centres (P, 3)."""
    normals, flatness, centres = np.empty((len(near), 3)), np.empty(len(near)), np.empty((len(near), 3))
    for rows in row_blocks(len(near)):
        around = rows_at(points, near[rows])
        centres[rows] = around.mean(axis=1)
        around -= centres[rows, None]
        values, axes = np.linalg.eigh(np.matmul(around.swapaxes(1, 2), around))
        normals[rows], flatness[rows] = axes[:, :, 0], np.maximum(values[:, 0], 0.0) / near.shape[1]
    return normals, flatness, centres


def on_planes(points: Array, count: int) -> Array:
    """Points (P, 3), each moved onto the plane of least squares through its `count` nearest, itself included."""
    tree, moved = cKDTree(points), []
    for part in np.array_split(points, 1 + len(points) * count // POINTS_AT_ONCE):
        normals, _, centres = local_planes(points, tree.query(part, k=count)[1])
        moved.append(part - ((part - centres) * normals).sum(axis=1, keepdims=True) * normals)
    return np.concatenate(moved)


def crease_points(points: Array, normals: Array, near: Indices, distance: Array, spacing: float, noise: float) -> Array:
    """Points where planes of neighbours meet, thinned to about the density of the cloud, (C, 3).

    Parameters
    ----------
    points, normals
        The cloud with one-sided normals, (P, 3).
    near, distance
        Neighbours of each point, itself first, and how far they are, (P, k).
    spacing, noise
        See `CloudGeometry`.
    """
    across = np.concatenate(
        [
            (np.abs(sum_of(rows_at(normals, near[rows]) * normals[rows, None])) < SHARPEST).sum(axis=1)
            for rows in row_blocks(len(near))
        ]
    )
    on_crease = np.flatnonzero((across >= FEWEST_ON_A_SIDE) & (near.shape[1] - across >= FEWEST_ON_A_SIDE))
    if len(on_crease) and near.shape[1] > 6:
        bent = deviation_from_quadric(points[near[on_crease]]) > BENT * spacing
        on_crease = on_crease[bent]
    if not len(on_crease):
        return np.zeros((0, 3))
    start, around, facing = points[on_crease], points[near[on_crease]], normals[near[on_crease]]
    matrix = np.matmul(facing.swapaxes(1, 2), facing)
    height = (facing * (around - start[:, None])).sum(axis=2)
    target = (facing * height[:, :, None]).sum(axis=1)
    values, axes = np.linalg.eigh(matrix)
    held = values > FLAT * values[:, 2:]
    inverse = np.where(held, 1.0 / np.where(held, values, 1.0), 0.0)
    move = np.matmul(axes, (inverse * np.matmul(axes.swapaxes(1, 2), target[:, :, None])[:, :, 0])[:, :, None])[:, :, 0]
    left = np.sqrt((((move[:, None] * facing).sum(axis=2) - height) ** 2).mean(axis=1))
    local = np.maximum(distance[on_crease, min(8, distance.shape[1] - 1)], spacing)
    good = (np.linalg.norm(move, axis=1) < LONGEST_MOVE * local) & (left < MOST_OFF_PLANES * local + noise) & held[:, 1]
    # Where points are much sparser than elsewhere a smooth bend looks like a crease.
    good &= local < SPARSEST * spacing
    return thinned((start + move)[good], 0.5 * spacing)


def thinned(points: Array, cell: float) -> Array:
    """One of the points in each cell of a grid, that nearest to their mean, in the order of the cells."""
    if not len(points):
        return points
    chosen: Array = points[one_in_each_cell(points, cell)[0]]
    return chosen

"""What the way a scan was made tells of its errors: levels that depths are rounded to, and lines with an error each."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Array
from ..mesh.normals import normals_and_areas
from ..mesh.quadrics import quadric_terms
from ..mesh.triangle_mesh import TriangleMesh
from .seeds import scattered

_UPRIGHT = 0.5  # of the mean normal along the axis: the surface is seen from one side
_FEWEST_LEVELS, _VERTICES_A_LEVEL = 4, 8
_EXACT = 1e-6  # of the extent: depths that differ by less are of one level
_DISKS, _FEWEST_DISKS, _RINGS = 1000, 100, 3
_SPAN = 1.5  # levels that the fit reaches across in a disk; with fewer, terraces cannot be told from shape
_ROUNDED = (0.17, 0.42)  # median distance of depths from the fit in levels: 0.25 where only rounding moves them
_MEDIAN_OF_ROUNDING = 0.25 * np.sqrt(12)  # of its standard deviation
_UNEVEN = 0.12  # largest difference of the fits' phases from an even distribution; stairs of n edges have 1 / (2 n)
_DIRECTIONS = 36
_SHARE = 0.05  # of the edges in a direction and its neighbours
ONLY_LINES = 0.9
"""Correlation along scan lines from which on there is nothing else; with joints, bricks in rows have up to 0.8."""

_ALIKE, _UNLIKE = 0.3, 0.6  # correlation of the relief along lines, and how much less it is across


def depth_rounding(mesh: TriangleMesh) -> float:
    """Return the standard deviation of the errors that rounding gave the depths, scene units; 0 where it did not.

    A depth camera tells depths in steps: along one axis there are few different coordinates.  Steps are told from
    terraces and stairs of the shape by where a smooth surface lies among the levels: anywhere, and as often between two
    as on one.
    """
    used = np.flatnonzero(mesh.used)
    positions = mesh.vertices[mesh.node_vertex]
    axis, leaning = _main_axis(mesh, positions)
    if leaning < _UPRIGHT or len(used) == 0:
        return 0.0
    depths = positions[:, axis]
    rounded = np.rint((depths - depths[used].min()) / max(_EXACT * float(np.ptp(depths[used])), 1e-300))
    levels, own = np.unique(rounded[used], return_inverse=True)
    if not _FEWEST_LEVELS <= len(levels) <= len(used) / _VERTICES_A_LEVEL:
        return 0.0
    level = np.zeros(len(depths))
    level[used] = own
    residuals, phases = _off_the_levels(mesh, np.delete(positions, axis, axis=1), level)
    if len(phases) < _FEWEST_DISKS or _unevenness(phases) > _UNEVEN:
        return 0.0
    median = float(np.median(residuals))
    if not _ROUNDED[0] <= median <= _ROUNDED[1]:
        return 0.0
    step = float(np.median(np.diff(levels))) * _EXACT * float(np.ptp(depths[used]))
    return step * median / _MEDIAN_OF_ROUNDING


def _main_axis(mesh: TriangleMesh, positions: Array) -> tuple[int, float]:
    """Return the axis along which the mean normal is longest, and how long it is there."""
    triangles = mesh.nodes.copy()
    turned = mesh.winding < 0
    triangles[turned] = triangles[turned, ::-1]
    normals, areas = normals_and_areas(positions, triangles)
    mean = np.abs((normals * areas[:, None]).sum(axis=0)) / max(float(areas.sum()), 1e-300)
    axis = int(mean.argmax())
    return axis, float(mean[axis])


def _off_the_levels(mesh: TriangleMesh, at: Array, level: Array) -> tuple[Array, Array]:
    """Return how far the levels, (N,), are from quadratics in some disks, and the phases of these in their middles."""
    seeds = scattered(np.flatnonzero(mesh.used & ~mesh.border))[:_DISKS]
    disks = csr_array((np.ones(len(seeds), dtype=bool), (np.arange(len(seeds)), seeds)), shape=(len(seeds), len(level)))
    for _ in range(_RINGS):
        disks = csr_array(disks @ mesh.reach)
    counts = np.diff(disks.indptr)
    inside = np.arange(int(counts.max(initial=0))) < counts[:, None]
    local, heights = np.zeros((*inside.shape, 2)), np.zeros(inside.shape)
    local[inside] = at[disks.indices] - np.repeat(at[seeds], counts, axis=0)
    heights[inside] = level[disks.indices] - np.repeat(level[seeds], counts)
    scale = np.sqrt((local**2).sum(axis=(1, 2)) / np.maximum(counts, 1))[:, None]
    local /= np.maximum(scale, 1e-300)[..., None]
    terms = quadric_terms(local[..., 0], local[..., 1], axis=1) * inside[:, None]
    gram = terms @ terms.transpose(0, 2, 1) + 1e-9 * np.maximum(counts, 1)[:, None, None] * np.eye(terms.shape[1])
    coefficients = np.linalg.solve(gram, terms @ heights[..., None])[..., 0]
    fitted = (coefficients[:, None] @ terms)[:, 0]
    span = np.where(inside, fitted, -np.inf).max(axis=1) - np.where(inside, fitted, np.inf).min(axis=1)
    told = (span >= _SPAN) & (counts > 2 * terms.shape[1])
    spread = np.sqrt(counts / np.maximum(counts - terms.shape[1], 1))[:, None]
    residuals = np.abs(heights - fitted) * spread
    return residuals[told][inside[told]], coefficients[told, 0] % 1.0


def _unevenness(phases: Array) -> float:
    """Return the largest difference of their distribution from an even one on the circle (after Kuiper), halved."""
    ordered = np.sort(phases)
    expected = np.arange(1, len(ordered) + 1) / len(ordered)
    off = expected - ordered
    return float(np.ptp(off) + 1 / len(ordered)) / 2


def scan_lines(mesh: TriangleMesh, relief: Array) -> float:
    """Return how much the fine relief of the nodes, (N,), is alike along lines of one direction, if it differs across.

    That is the correlation of neighbours; 1 where there is nothing but lines, 0 where they are not alike along any
    direction or along all: independent errors, and a camera's, are as much alike in each.
    """
    positions = mesh.vertices[mesh.node_vertex]
    axis, leaning = _main_axis(mesh, positions)
    inside = mesh.used & ~mesh.border
    one, other = mesh.edges[inside[mesh.edges].all(axis=1)].T
    if leaning < _UPRIGHT or len(one) == 0:
        return 0.0
    along = np.delete(positions[other] - positions[one], axis, axis=1)
    direction = (np.arctan2(along[:, 1], along[:, 0]) / np.pi % 1.0 * _DIRECTIONS).astype(np.int64) % _DIRECTIONS
    sums = np.stack(
        [
            _with_both_sides(np.bincount(direction, weight, _DIRECTIONS).astype(np.float64))
            for weight in (np.ones(len(one)), relief[one] * relief[other], (relief[one] ** 2 + relief[other] ** 2) / 2)
        ]
    )
    rest = sums.sum(axis=1, keepdims=True) / 3 - sums
    many = sums[0] >= _SHARE * len(one)
    alike = np.divide(sums[1], sums[2], out=np.full(_DIRECTIONS, -1.0), where=many & (sums[2] > 0))
    best = int(alike.argmax())
    across = rest[1, best] / max(float(rest[2, best]), 1e-300)
    return float(alike[best]) if alike[best] >= _ALIKE and alike[best] - across >= _UNLIKE else 0.0


def _with_both_sides(sums: Array) -> Array:
    """Return the sums of each direction and the two beside it."""
    both: Array = sums + np.roll(sums, 1) + np.roll(sums, -1)
    return both

"""Level sets of functions around a point cloud: a grid that exists near the points only, and marching tetrahedra.

Each cube of the grid is split into six tetrahedra around its diagonal, alike in every cube, so that neighbours share
their faces' diagonals and the surface is a manifold (Freudenthal 1942; Doi, Koide 1991).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from ..arrays import Array, Indices

ENDS = 0.15
"""A vertex keeps this share of a grid edge's length from its ends, so that no triangle is empty."""

_EVEN = np.array([[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]])
"""Even permutations of a tetrahedron's corners that put each of them first."""

_PAIRS = np.array([[0, 1, 2, 3], [0, 2, 3, 1], [0, 3, 1, 2], [1, 2, 0, 3], [1, 3, 2, 0], [2, 3, 0, 1]])
"""Even permutations that put each pair of them first."""


@dataclass(frozen=True)
class Grid:
    """The nodes of a regular grid that lie near points.

    Attributes
    ----------
    nodes
        Whole coordinates of each node, (N, 3), in the order of their keys.
    keys
        (N,) sorted numbers that stand for the nodes.
    shape
        Nodes along each axis of the box that holds them all.
    origin, step
        A node's position is origin + step * coordinates.
    """

    nodes: Indices
    keys: Indices
    shape: Indices
    origin: Array
    step: float

    @classmethod
    def around(cls, points: Array, reach: float, step: float) -> Grid:
        """Take every node within `reach` of a point (P, 3), along each axis."""
        width = int(np.ceil(reach / step)) + 1
        origin = points.min(axis=0) - (width + 1) * step
        cells = np.floor((points - origin) / step).astype(np.int64)
        shape = cells.max(axis=0) + width + 3
        strides = np.array([shape[1] * shape[2], shape[2], 1])
        keys = np.unique(cells @ strides)
        for stride in strides:  # one axis after another: a cube around each cell, without repetitions in between
            keys = np.unique(keys[:, None] + stride * np.arange(-width, width + 2))
        nodes = np.stack([keys // strides[0], keys // strides[1] % shape[1], keys % shape[2]], axis=1)
        return cls(nodes, keys, shape, origin, step)

    @property
    def positions(self) -> Array:
        """Where the nodes are, (N, 3)."""
        return self.origin + self.step * self.nodes

    def cubes(self, values: Array) -> Indices:
        """Return the nodes at the corners of each cube on which the values (N,) change sign, (C, 8).

        A cube whose values are not all finite is left out.
        """
        corner = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
        wanted = self.keys[:, None] + corner @ [self.shape[1] * self.shape[2], self.shape[2], 1]
        found = np.minimum(np.searchsorted(self.keys, wanted), len(self.keys) - 1)
        there = (self.keys[found] == wanted).all(axis=1)
        found = found[there]
        inside = (values[found] < 0.0).sum(axis=1)
        chosen: Indices = found[(inside > 0) & (inside < 8) & np.isfinite(values[found]).all(axis=1)]
        return chosen


def level_set(grid: Grid, values: Array) -> tuple[Array, Indices]:
    """Triangulate where the values (N,) at a grid's nodes are zero, wound so that normals point to positive values.

    Where nodes are missing, or have no finite value, the surface has a border.

    Returns
    -------
    Vertices (V, 3) and triangles (T, 3).
    """
    cubes = grid.cubes(values)
    tetrahedra = cubes[:, _tetrahedra()].reshape(-1, 4)
    inside = values[tetrahedra] < 0.0
    count = inside.sum(axis=1)
    sides = []
    for corner, order in enumerate(_EVEN):
        for alone, turned in ((1, [0, 1, 2]), (3, [0, 2, 1])):
            one = tetrahedra[(count == alone) & (inside[:, corner] == (alone == 1))][:, order]
            ends = np.stack([np.stack([one[:, 0], one[:, other]], axis=1) for other in (1, 2, 3)], axis=1)
            sides.append(ends[:, turned])
    for order in _PAIRS:
        p, q, r, s = tetrahedra[(count == 2) & inside[:, order[:2]].all(axis=1)][:, order].T
        quad = [np.stack(ends, axis=1) for ends in ((p, r), (p, s), (q, s), (q, r))]
        sides += [np.stack([quad[0], quad[1], quad[2]], axis=1), np.stack([quad[0], quad[2], quad[3]], axis=1)]
    ends = np.sort(np.concatenate(sides).reshape(-1, 2), axis=1)
    keys, corners = np.unique(ends[:, 0] * len(values) + ends[:, 1], return_inverse=True)
    start, end = np.divmod(keys, len(values))
    share = np.clip(values[start] / (values[start] - values[end]), ENDS, 1.0 - ENDS)[:, None]
    positions = grid.positions
    return (1.0 - share) * positions[start] + share * positions[end], corners.reshape(-1, 3).astype(np.int64)


def _tetrahedra() -> Indices:
    """Corners of a cube, numbered 4 x + 2 y + z, of its six tetrahedra, each wound alike, (6, 4)."""
    found = []
    for path in permutations((4, 2, 1)):
        way = [0, path[0], path[0] + path[1], 7]
        even = path in ((4, 2, 1), (2, 1, 4), (1, 4, 2))
        found.append(way if even else [way[0], way[1], way[3], way[2]])
    return np.array(found)

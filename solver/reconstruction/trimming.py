"""A base cut off where the points end: where they are far away, or much sparser than elsewhere."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array, Booleans, Indices
from ..errors import InputError
from ..mesh.refinement import bisected
from ..mesh.sampling import triangle_grid
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import CloudSettings
from .base import border_near_points, checked_base
from .geometry import spacings
from .shell import unpinched, without_loose, without_slivers

NEIGHBOURS = 9
"""Points, the first at distance zero on a point, that show how dense the cloud is at a place."""

ROUNDS = 3
"""How often triangles are halved that a cut crosses and whose corners do not show it."""

GRID = triangle_grid(6)

HALVINGS = 12
"""Steps in which the place is found where an edge is cut."""

ENDS = 0.15
"""A cut keeps this share of an edge's length from its ends, so that no triangle is empty."""

Beyond = Callable[[Array], Booleans]
"""Tells which positions (N, 3) are to be cut off, (N,)."""


def trimmed(mesh: TriangleMesh, points: Array, spacing: float, cloud: CloudSettings) -> TriangleMesh:
    """Cut a base off where `cloud.trim_distance` or `cloud.trim_density` says so; where neither does, return it.

    Parameters
    ----------
    points, spacing
        The cloud, (P, 3), and what `CloudGeometry` says of it.

    Raises
    ------
    InputError
        When nothing would be left.
    """
    if not cloud.trim_distance and not cloud.trim_density:
        return mesh
    beyond = _beyond(points, spacing, cloud)
    vertices, triangles = mesh.vertices, mesh.triangles
    # shorter sides along the cut: long ones reach beyond between their ends
    vertices, triangles = bisected(vertices, triangles, _crossed(vertices, triangles, beyond))
    for _ in range(ROUNDS):
        hidden = _hidden(vertices, triangles, beyond)
        if not hidden.any():
            break
        vertices, triangles = bisected(vertices, triangles, hidden)
    vertices, triangles = cut(vertices, triangles, beyond)
    if not len(triangles):
        raise InputError("Nothing is left of the surface: trim it less.")
    left = checked_base(*unpinched(*without_slivers(*without_loose(vertices, triangles))))
    return border_near_points(left, points, cloud.trim_distance) if cloud.trim_distance else left


def _beyond(points: Array, spacing: float, cloud: CloudSettings) -> Beyond:
    tree, count = cKDTree(points), min(NEIGHBOURS, len(points))
    farthest = cloud.trim_distance or np.inf
    sparsest = spacing / np.sqrt(cloud.trim_density) if cloud.trim_density else np.inf

    def beyond(positions: Array) -> Booleans:
        distance = tree.query(positions, k=count)[0]
        return np.asarray((distance[:, 0] > farthest) | (spacings(distance) > sparsest), dtype=np.bool_)

    return beyond


def _hidden(vertices: Array, triangles: Indices, beyond: Beyond) -> Booleans:
    """Which triangles are cut inside, though all their corners lie on one side."""
    places = np.einsum("qk,tkd->tqd", GRID, vertices[triangles])
    off = beyond(places.reshape(-1, 3)).reshape(len(triangles), -1)
    corners = beyond(vertices)[triangles]
    same = corners.all(axis=1) | ~corners.any(axis=1)
    return np.asarray(same & (off != corners[:, :1]).any(axis=1), dtype=np.bool_)


def _crossed(vertices: Array, triangles: Indices, beyond: Beyond) -> Booleans:
    """Which triangles have corners on both sides of the cut."""
    corners = beyond(vertices)[triangles]
    return np.asarray(corners.any(axis=1) & ~corners.all(axis=1), dtype=np.bool_)


def cut(vertices: Array, triangles: Indices, beyond: Beyond) -> tuple[Array, Indices]:
    """Cut triangles (T, 3) where they go beyond; each keeps its winding.  Vertices that nothing uses may be left."""
    count, off = len(vertices), beyond(vertices)
    number = off[triangles].sum(axis=1)
    pieces, ends = [triangles[number == 0]], []
    for corner in range(3):
        turned = np.roll(triangles, -corner, axis=1)
        tip = turned[(number == 2) & ~off[turned[:, 0]]]  # of which the first corner stays
        stump = turned[(number == 1) & off[turned[:, 0]]]  # of which all but the first corner stays
        ends += [tip[:, [0, 1]], tip[:, [0, 2]], stump[:, [1, 0]], stump[:, [2, 0]]]
        pieces += [tip, stump]
    keys = np.unique(np.concatenate([pair[:, 0] * count + pair[:, 1] for pair in ends]))
    start, end = np.divmod(keys, count)

    def between(one: Indices, other: Indices) -> Indices:
        return count + np.searchsorted(keys, one * count + other)

    made = pieces[:1]
    for tip, stump in zip(pieces[1::2], pieces[2::2], strict=True):
        a, b, c = tip.T
        made.append(np.stack([a, between(a, b), between(a, c)], axis=1))
        a, b, c = stump.T
        made += [np.stack([between(b, a), b, c], axis=1), np.stack([between(b, a), c, between(c, a)], axis=1)]
    return np.concatenate([vertices, _crossing(vertices[start], vertices[end], beyond)]), np.concatenate(made)


def _crossing(inside: Array, outside: Array, beyond: Beyond) -> Array:
    """Where edges from positions inside to positions beyond are cut, (N, 3)."""
    low, high = np.zeros(len(inside)), np.ones(len(inside))
    for _ in range(HALVINGS if len(inside) else 0):
        middle = 0.5 * (low + high)
        off = beyond(inside + middle[:, None] * (outside - inside))
        low, high = np.where(off, low, middle), np.where(off, middle, high)
    share = np.clip(low, ENDS, 1.0 - ENDS)[:, None]
    return inside + share * (outside - inside)

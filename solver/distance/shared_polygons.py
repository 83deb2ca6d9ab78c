"""The last step of an alignment where both meshes have the same polygons: vertices are paired with vertices.

A point may slide along a surface without coming closer to it.  Hence the nearest point of a surface tells one
coordinate of a noisy vertex's displacement, the vertex that it was made from tells three, and the best motion that
knows these pairs is about half as far off.  An edited, denoised or approximated copy has most triangles of its
original, a scan has hardly any: so the triangles tell whether the pairs mean anything.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array, Booleans, Indices, sum_of
from ..mesh.normals import area_vectors, cross, normals_around, unit
from ..mesh.welding import may_coincide
from .motions import moved_by, small_motion
from .surfaces import Surface

SHARED = 0.5
"""Share of A's triangles that B has, too, from which on vertices are paired."""

TRIANGLES = 100_000
"""At most about this many of A's triangles are looked at."""

FAR_PAIR = 4.0
"""A pair is left out when it is this many times as far apart as the median pair."""

STEPS = 6
UNEVEN = 1e3
"""Displacements along and across the surface are told apart up to this ratio."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Vertices of A with those of B that they belong to.

    Attributes
    ----------
    share
        Of A's triangles: how many B has, too.
    apart
        Median distance of A's vertices from the nearest ones of B, in scene units.
    one, other
        Vertices of A and of B, (N,) each: the corners of these triangles.
    """

    share: float
    apart: float
    one: Indices
    other: Indices


class Corners:
    """Vertices and triangles of B, to be found again in A."""

    def __init__(self, b: Surface) -> None:
        self.points, triangles = b.vertices, b.triangles
        if may_coincide(b.vertices, 0.0):  # triangles that share no vertices, as in an .stl
            self.points, place = np.unique(b.vertices, axis=0, return_inverse=True)
            triangles = place.reshape(-1)[triangles]
        self.normals = normals_around(area_vectors(self.points, triangles), triangles, len(self.points))
        self._tree = cKDTree(self.points)
        sides, third = self._named(triangles)
        order = np.argsort(sides, kind="stable")
        self._sides, self._third = sides[order], third[order]

    def pairs(self, points: Array, triangles: Indices) -> Pairs:
        """Pair A's vertices, (V, 3), moved to where they belong, with the nearest ones of B."""
        used, corners = np.unique(triangles, return_inverse=True)
        distance, nearest = self._tree.query(points[used])
        nearest = nearest.astype(np.int64)
        corners = corners.reshape(-1, 3)
        known = self._has(nearest[corners])
        paired = np.unique(corners[known])
        return Pairs(float(known.mean()), float(np.median(distance)), used[paired], nearest[paired])

    def _named(self, triangles: Indices) -> tuple[Indices, Indices]:
        """Return one number for the side behind the lowest corner of each triangle, and its third corner, (T,) each."""
        first = triangles.argmin(axis=1)
        i, j, k = (np.take_along_axis(triangles, ((first + n) % 3)[:, None], axis=1)[:, 0] for n in range(3))
        return i * np.int64(len(self.points)) + j, k

    def _has(self, triangles: Indices) -> Booleans:
        sides, third = self._named(triangles)
        at = np.minimum(np.searchsorted(self._sides, sides), len(self._sides) - 1)
        return np.asarray((self._sides[at] == sides) & (self._third[at] == third))


def move_corners(vertices: Array, triangles: Indices, corners: Corners, start: Array, scaled: bool) -> Array:
    """Return the motion, (4, 4), that brings A's vertices closest to those of B that they belong to.

    Parameters
    ----------
    vertices, triangles
        A, (V, 3), and some of its triangles, (T, 3).
    corners
        Of B.
    start
        Moves A so near to B, (4, 4), that most vertices are nearest to their own.
    scaled
        Whether the size may change.
    """
    matrix = start
    for _ in range(STEPS):
        moved = moved_by(matrix, vertices)
        pairs = corners.pairs(moved, triangles)
        partners, normals = corners.points[pairs.other], corners.normals[pairs.other]
        matrix = _step(moved[pairs.one], partners, normals, scaled) @ matrix
    return matrix


def _step(points: Array, partners: Array, normals: Array, scaled: bool) -> Array:
    """Return the small motion that brings points closest to partners; each direction counts by how well it fits."""
    apart = partners - points
    distance = np.linalg.norm(apart, axis=1)
    kept = distance <= FAR_PAIR * np.median(distance)
    points, partners, normals, apart = (each[kept] for each in (points, partners, normals, apart))
    across = float(np.sqrt((sum_of(apart * normals) ** 2).mean()))
    along = float(np.sqrt(max((apart**2).sum(axis=1).mean() - across**2, 0.0) / 2.0))
    least = max(across, along) / UNEVEN
    if least == 0.0:
        return np.eye(4)
    tangents = unit(cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)]))
    frame = [normals / max(across, least), *(each / max(along, least) for each in (tangents, cross(normals, tangents)))]
    return small_motion(np.tile(points, (3, 1)), np.tile(partners, (3, 1)), np.concatenate(frame), scaled)

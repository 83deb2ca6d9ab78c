"""What is compared: a mesh or a point cloud, with places spread evenly over it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Indices, rows_at, sum_of
from ..errors import InputError
from ..mesh.input_checks import checked_faces, checked_vertices
from ..mesh.normals import normals_and_areas
from ..mesh.objects import given_mesh
from ..mesh.triangulation import triangulate
from .signs import Sides
from .targets import PointTarget, Target, TriangleTarget

_SPREAD = np.array([0.7548776662466927, 0.5698402909980532])
"""Steps of an evenly spread sequence in the unit square: powers of the plastic number's inverse."""

PLACES_AT_ONCE = 1 << 16
"""Places that are found together: more would only take memory."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh, or a point cloud where there are no triangles.

    Attributes
    ----------
    vertices
        (V, 3), in scene units.
    triangles
        (T, 3), those without an area left out; none: the vertices are a point cloud.
    """

    vertices: Array
    triangles: Indices

    @classmethod
    def of(cls, vertices: ArrayLike, triangles: ArrayLike | None = None) -> Surface:
        """Check the arrays.

        Raises
        ------
        InputError
            When there is no vertex, a coordinate is not finite, or a triangle names a vertex that does not exist or
            has other than three corners.
        """
        points = checked_vertices(vertices)
        rows = np.zeros((0, 3), dtype=np.int64) if triangles is None else np.asarray(triangles, dtype=np.int64)
        if rows.size and rows.shape[-1] != 3:
            raise InputError(f"Triangles have three corners, not {rows.shape[-1]}.")
        rows = rows.reshape(-1, 3)
        if len(rows) and (rows.min() < 0 or rows.max() >= len(points)):
            raise InputError(f"A triangle names a vertex that does not exist; there are {len(points)}.")
        if len(rows):
            rows = rows[normals_and_areas(points, rows)[1] > 0.0]
            if not len(rows):
                raise InputError("The mesh has no area.")
        return cls(points, rows)

    @classmethod
    def from_object(cls, surface: Any) -> Surface:
        """Take a surface, points (N, 3), or what `given_mesh` takes.

        Raises
        ------
        InputError
            When it is none of them.
        """
        if isinstance(surface, Surface):
            return surface
        if isinstance(surface, np.ndarray):
            return cls.of(surface)
        given = given_mesh(surface)
        points = checked_vertices(given.vertices)
        corners, offsets = checked_faces(given.faces, len(points))
        return cls.of(points, triangulate(points, corners, offsets)[0])

    @property
    def is_mesh(self) -> bool:
        """Whether there are triangles."""
        return len(self.triangles) > 0

    @property
    def longest_side(self) -> float:
        """Longest side of the bounding box of all vertices."""
        return float(np.ptp(self.vertices, axis=0).max())

    @cached_property
    def target(self) -> Target:
        """What distances are measured to."""
        return TriangleTarget(self.vertices, self.triangles) if self.is_mesh else PointTarget(self.vertices)

    @cached_property
    def sides(self) -> Sides:
        """Which places lie inside; for a mesh only."""
        return Sides(self.vertices, self.triangles)

    def moved(self, matrix: Array) -> Surface:
        """Return the surface moved by a 4 x 4 matrix."""
        return Surface(self.vertices @ matrix[:3, :3].T + matrix[:3, 3], self.triangles)

    def samples(self, count: int) -> Array:
        """Return places on the surface, each for an equal share of the area, (count, 3); of a cloud all points.

        The same mesh gives the same places.
        """
        return self.samples_and_triangles(count)[0] if self.is_mesh else self.vertices

    def samples_and_triangles(self, count: int) -> tuple[Array, Indices]:
        """Return places on a mesh as `samples` does, and the triangle of each, (count,)."""
        areas = normals_and_areas(self.vertices, self.triangles)[1].cumsum()
        triangle = np.searchsorted(areas, (np.arange(count) + 0.5) * (areas[-1] / count))
        triangle = np.minimum(triangle, len(areas) - 1)
        places = np.empty((count, 3))
        for start in range(0, count, PLACES_AT_ONCE):
            own = slice(start, start + PLACES_AT_ONCE)
            shares = (0.5 + np.arange(start + 1, start + 1 + len(places[own]))[:, None] * _SPREAD) % 1.0
            over = sum_of(shares) > 1.0
            shares[over] = 1.0 - shares[over]
            a, b, c = (rows_at(self.vertices, corner) for corner in rows_at(self.triangles, triangle[own]).T)
            places[own] = a + shares[:, :1] * (b - a) + shares[:, 1:] * (c - a)
        return places, triangle

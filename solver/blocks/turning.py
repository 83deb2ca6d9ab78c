"""How far the normals of faces turn; numbers that can be summed over parts of a mesh."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import Array, Indices
from ..mesh.normals import angle_between, face_normals
from ..mesh.triangulation import triangulate
from ..surface.metrics import faces_turned


class Turning(NamedTuple):
    """Sum of the angles between the normals of triangles in radians, number of triangles, faces turned by over 90°."""

    angles: float = 0.0
    triangles: int = 0
    turned: int = 0

    @classmethod
    def of(cls, before: Array, after: Array, corners: Indices, offsets: Indices) -> Turning:
        """Compare polygons between two meshes, (n, 3) each; triangles without area do not count."""
        triangles = triangulate(before, corners, offsets)[0]
        normals = face_normals(before, triangles), face_normals(after, triangles)
        both = normals[0].any(axis=1) & normals[1].any(axis=1)
        angles = angle_between(normals[0][both], normals[1][both])
        return cls(float(angles.sum()), int(both.sum()), faces_turned(before, after, offsets, corners))

    def plus(self, other: Turning) -> Turning:
        """Return the sums of both."""
        return Turning(self.angles + other.angles, self.triangles + other.triangles, self.turned + other.turned)

    @property
    def degrees(self) -> float:
        """Mean angle in degrees."""
        return float(np.degrees(self.angles / max(self.triangles, 1)))

"""Parameter correction (Hoschek 1988): the place on the base of the surface's point nearest to each observed point."""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices
from ..mesh.closest_points import Footpoints
from ..mesh.projection import walk
from ..mesh.triangle_mesh import TriangleMesh
from ..surface.representation import Representation

SHORTEST_STEP = 1e-3
"""Steps that change barycentric coordinates by less are not worth another evaluation."""


def nearest_on_surface(
    representation: Representation, mesh: TriangleMesh, points: Array, start: Footpoints, steps: int
) -> tuple[Footpoints, Array]:
    """Walk towards the surface's points nearest to `points` (P, 3), each from its own start.

    Returns
    -------
    footpoints, distance
        The nearest places on the way, and how far they are from the points, (P,).
    """
    nearest = np.full(len(points), np.inf)
    triangle, barycentric = start.triangle.copy(), start.barycentric.copy()

    def keep(which: Indices, feet: Footpoints, missing: Array) -> None:
        distance = np.linalg.norm(missing, axis=1)
        closer = distance < nearest[which]
        where = which[closer]
        nearest[where], triangle[where] = distance[closer], feet.triangle[closer]
        barycentric[where] = feet.barycentric[closer]

    def misses(which: Indices, feet: Footpoints) -> tuple[Array, Array]:
        on_surface, tangents = representation.evaluate_with_tangents(feet.triangle, feet.barycentric)
        missing = points[which] - on_surface
        keep(which, feet, missing)
        return missing, tangents.swapaxes(1, 2)

    found, arrived = walk(mesh, start, misses, steps, SHORTEST_STEP)
    last = np.flatnonzero(~arrived)
    feet = Footpoints(found.triangle[last], found.barycentric[last])
    keep(last, feet, points[last] - representation.evaluate(feet.triangle, feet.barycentric))
    return Footpoints(triangle, barycentric), nearest

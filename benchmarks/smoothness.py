"""How smooth the evaluated surface is: by how much it bends at the edges of its mesh, on patch rims and elsewhere.

The surface is continuous everywhere, but its weights and domain transformations are piecewise linear, so it bends a
little at every edge; at a crease of the input it bends as the crease does.  Where a patch ends it must not bend more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..solver.surface.metrics import EDGE_SAMPLES, pairs_across_edges
from ..solver.surface.representation import Representation

Array = NDArray[np.float64]

EDGES_AT_ONCE = 100_000

CREASE_ANGLE = 15.0
"""Degrees from which an edge of the input counts as a crease."""


@dataclass(frozen=True)
class Bends:
    """Angles in degrees at the E edges between two triangles.

    Attributes
    ----------
    surface
        Between the surface's normals on both sides, the mean of a few points of the edge, (E,).
    mesh
        Between the normals of the input's two triangles, (E,).
    on_rim
        Edges along which the rim of a patch runs, (E,).
    """

    surface: Array
    mesh: Array
    on_rim: NDArray[np.bool_]

    def quantiles(self, shares: tuple[float, ...] = (0.5, 0.9, 0.99)) -> dict[str, dict[str, list[float]]]:
        """Return quantiles of both angles for rims and the rest, on creases of the input and away from them.

        A list is empty if no edge is of that kind.
        """
        groups = {"rims": self.on_rim, "elsewhere": ~self.on_rim}
        crease = self.mesh >= CREASE_ANGLE
        kinds = {"smooth": ~crease, "creases": crease}
        return {
            f"{kind}, {group}": {
                name: [float(value) for value in np.quantile(angles[which], shares)] if which.any() else []
                for name, angles in (("surface", self.surface), ("mesh", self.mesh))
            }
            for kind, of_kind in kinds.items()
            for group, of_group in groups.items()
            for which in [of_kind & of_group]
        }


def bends(representation: Representation) -> Bends:
    """Measure by how much the surface bends at each edge of its mesh."""
    pairs = pairs_across_edges(representation)
    surface = np.empty(len(pairs))
    for start in range(0, len(pairs), EDGES_AT_ONCE):
        part = slice(start, start + EDGES_AT_ONCE)
        triangles, inside = pairs.select(part).samples(EDGE_SAMPLES)
        normals = representation.normals(triangles.ravel(), inside.reshape(-1, 3)).reshape(inside.shape)
        surface[part] = _angles(normals[:, 0], normals[:, 1]).mean(axis=0)
    a, b, c = (representation.vertices[representation.triangles[:, k]] for k in range(3))
    flat = np.cross(b - a, c - a)
    mesh = _angles(flat[pairs.triangles[0]], flat[pairs.triangles[1]])
    # Triangles of a surface that cannot be oriented, or is not, may be wound against each other.
    along = pairs.corners[..., 1] - pairs.corners[..., 0]
    against = (along[0] % 3) == (along[1] % 3)
    return Bends(np.where(against, 180.0 - surface, surface), np.where(against, 180.0 - mesh, mesh), pairs.on_rim)


def _angles(one: Array, other: Array) -> Array:
    """Angles between vectors (..., 3), in degrees; 0 where one of them has no length."""
    across = np.linalg.norm(np.cross(one, other), axis=-1)
    return np.asarray(np.degrees(np.arctan2(across, (one * other).sum(axis=-1))), dtype=np.float64)

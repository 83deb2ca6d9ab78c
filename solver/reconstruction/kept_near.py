"""Keeping the surface near its points or its base, whatever the patches do.

A patch may swing out where it has few points: at a long triangle on the border of an open base, over a gap.  Lower
degrees calm most of them (see `oscillation`).  Where the surface still leaves both the points and the base, vertices
pass through: there it becomes the base itself.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Booleans, Indices
from ..mesh.sampling import triangle_grid
from ..surface.bounds import exceeding
from .oscillation import CloudSurface
from .tangent_planes import TangentPlanes

GRID = triangle_grid(16)
"""Where triangles that may be far from the base are compared with the points."""

ROUNDS = 4

TRIANGLES_AT_ONCE = 2000


def kept_near(surface: CloudSurface, planes: TangentPlanes) -> int:
    """Let the base through where the surface has run away from it and from the points.

    The surface stays as it is where its guaranteed bound says that it is near the base.

    Returns
    -------
    int
        How many vertices are the base's own.
    """
    mesh, asked = surface.mesh, np.arange(len(surface.mesh.triangles))
    passed = np.zeros(len(mesh.vertices), dtype=bool)
    for _ in range(ROUNDS):
        far = asked[_runs_away(surface, planes, asked)]
        if not len(far):
            break
        vertices = np.zeros(len(mesh.vertices), dtype=bool)
        vertices[mesh.triangles[far]] = True
        passed |= vertices
        surface.pass_through(vertices)
        asked = np.flatnonzero(vertices[mesh.triangles].any(axis=1))
    return int((passed & ~mesh.passed_through).sum())


def _runs_away(surface: CloudSurface, planes: TangentPlanes, asked: Indices) -> Booleans:
    """Which of the triangles have a place from which the surface has run away."""
    representation, result = surface.representation(), np.zeros(len(asked), dtype=bool)
    possible = np.flatnonzero(exceeding(representation, min(planes.room, planes.spike), asked))
    for part in np.array_split(possible, -(-len(possible) // TRIANGLES_AT_ONCE)) if len(possible) else []:
        triangles = np.repeat(asked[part], len(GRID))
        shares = np.tile(GRID, (len(part), 1))
        on_surface = representation.evaluate(triangles, shares)
        on_base = np.einsum("nk,nkd->nd", shares, representation.vertices[representation.triangles[triangles]])
        away = planes.run_away(on_surface, on_base) > 0.0
        away[away] = ~planes.nearer(on_surface[away], on_base[away])
        away |= planes.spikes(on_surface, on_base)
        result[part] = away.reshape(len(part), len(GRID)).any(axis=1)
    return result

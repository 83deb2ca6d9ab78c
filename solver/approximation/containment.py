"""Keeping the surface inside the box of its input, whatever the patches do.

Patches that swing out have been refitted with lower degrees by now (see `oscillation`).  Where the surface still leaves
the input's bounding box, vertices pass through: there the surface becomes the input itself.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Booleans, Indices
from ..mesh.sampling import triangle_grid
from ..surface.bounds import error_bounds, exceeding
from .oscillation import MeshSurface

ROOM = 0.019
"""How far the surface may leave the box of its input, as a share of the longest side."""

GRID = triangle_grid(12)
"""Where triangles with large errors are compared with the box."""

ROUNDS = 3


def kept_inside(surface: MeshSurface, *, bounded: bool = True) -> tuple[int, tuple[float, float] | None]:
    """Let vertices through where the surface leaves the input's box.

    Parameters
    ----------
    bounded
        Whether to bound the error of the whole surface, which takes long on large meshes.

    Returns
    -------
    reproduced
        How many vertices it took.
    bounds
        What `error_bounds` says of the surface then; None if not `bounded`.
    """
    bounds = error_bounds(surface.representation()) if bounded else None
    # only a large error leads far out of the box
    if bounds is not None and bounds[1] <= ROOM * surface.mesh.longest_side:
        return 0, bounds
    reproduced = _let_through(surface)
    return reproduced, error_bounds(surface.representation()) if bounded and reproduced else bounds


def _let_through(surface: MeshSurface) -> int:
    mesh = surface.mesh
    reproduced, asked = np.zeros(len(mesh.vertices), dtype=bool), np.arange(len(mesh.triangles))
    for _ in range(ROUNDS):
        outside = _outside(surface, asked)
        if not outside.any():
            break
        vertices = np.zeros(len(mesh.vertices), dtype=bool)
        vertices[mesh.triangles[outside]] = True
        reproduced |= vertices
        surface.pass_through(vertices)
        asked = np.flatnonzero(vertices[mesh.triangles].any(axis=1))
    return int((reproduced & ~mesh.passed_through).sum())


def _outside(surface: MeshSurface, asked: Indices) -> Booleans:
    """Triangles among those asked for that leave the box, (T,)."""
    mesh, representation = surface.mesh, surface.representation()
    room = ROOM * mesh.longest_side
    far = asked[exceeding(representation, room, asked)]
    points = representation.evaluate(np.repeat(far, len(GRID)), np.tile(GRID, (len(far), 1))).reshape(-1, len(GRID), 3)
    used = mesh.vertices[np.unique(mesh.triangles)]
    out = ((points < used.min(axis=0) - room) | (points > used.max(axis=0) + room)).any(axis=(1, 2))
    result = np.zeros(len(mesh.triangles), dtype=bool)
    result[far[out]] = True
    return result

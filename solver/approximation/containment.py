"""Keeping the surface inside the box of its input, whatever the patches do.

Patches that swing out have been refitted with lower degrees by now (see `oscillation`).  Where the surface still leaves
the input's bounding box, vertices pass through: there the surface becomes the input itself.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Booleans, Indices, named_by
from ..mesh.sampling import triangle_grid
from ..processes.each import Each
from ..surface.bounds import error_bounds, exceeding
from ..surface.representation import Representation
from .oscillation import UNEVEN, MeshSurface, UnevenTriangles

ROOM = 0.019
"""How far the surface may leave the box of its input, as a share of the longest side."""

GRID = triangle_grid(12)
"""Where triangles with large errors are compared with the box."""

RINGS = 3
"""How far around uneven triangles a patch may swing out, in rings of triangles."""

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
    each = surface.runner.each
    bounds = error_bounds(surface.representation(), each=each) if bounded else None
    # only a large error leads far out of the box
    if bounds is not None and bounds[1] <= ROOM * surface.mesh.longest_side:
        return 0, bounds
    reproduced = _let_through(surface, _around_uneven(surface.representation(), each))
    return reproduced, error_bounds(surface.representation(), each=each) if bounded and reproduced else bounds


def _around_uneven(representation: Representation, each: Each) -> Indices:
    """Mesh triangles in the rings around uneven ones, in space or in a patch's domain, where a spike may be short.

    Elsewhere a surface bulges, but does not swing out.
    """
    corners = representation.vertices[representation.triangles]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    uneven = sides > UNEVEN * np.median(sides) if len(sides) else np.zeros(0, dtype=bool)
    uneven[UnevenTriangles.of(representation, each).mesh_triangles] = True
    triangles = np.flatnonzero(uneven)
    for _ in range(RINGS):
        near = np.zeros(len(representation.vertices), dtype=bool)
        near[representation.triangles[triangles]] = True
        triangles = np.flatnonzero(near[representation.triangles].any(axis=1))
    return triangles


def _let_through(surface: MeshSurface, asked: Indices) -> int:
    mesh = surface.mesh
    reproduced = np.zeros(len(mesh.vertices), dtype=bool)
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
    far = asked[exceeding(representation, room, asked, each=surface.runner.each)]
    points = representation.evaluate(np.repeat(far, len(GRID)), np.tile(GRID, (len(far), 1))).reshape(-1, len(GRID), 3)
    used = mesh.vertices[named_by(mesh.triangles, len(mesh.vertices))]
    out = ((points < used.min(axis=0) - room) | (points > used.max(axis=0) + room)).any(axis=(1, 2))
    result = np.zeros(len(mesh.triangles), dtype=bool)
    result[far[out]] = True
    return result

"""Keeping the surface inside the box of its input, whatever the patches do.

Patches that swing out have been refitted with lower degrees by now (see `oscillation`).  Where the surface still leaves
the bounding box of its connected piece, vertices pass through: there the surface becomes the input itself.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Booleans, Indices
from ..mesh.sampling import triangle_grid
from ..mesh.triangle_mesh import TriangleMesh
from ..processes.each import Each
from ..surface.bounds import error_bounds, exceeding
from ..surface.representation import Representation
from .oscillation import UNEVEN, MeshSurface, UnevenTriangles

ROOM = 0.019
"""How far the surface may leave the box of a connected piece, as a share of its longest side."""

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
    if bounds is not None and bounds[1] <= ROOM * surface.mesh.piece_sizes.min(initial=np.inf):
        return 0, bounds
    reproduced = _let_through(surface, _around_uneven(surface.mesh, surface.representation(), each))
    return reproduced, error_bounds(surface.representation(), each=each) if bounded and reproduced else bounds


def _around_uneven(mesh: TriangleMesh, representation: Representation, each: Each) -> Indices:
    """Mesh triangles in the rings around uneven ones, in space or in a patch's domain, where a spike may be short.

    Elsewhere a surface bulges, but does not swing out.
    """
    corners = representation.vertices[representation.triangles]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    usual = mesh.pieces.medians(sides, mesh.triangle_pieces)
    uneven = sides > UNEVEN * usual[mesh.triangle_pieces]
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
    far = asked[exceeding(representation, ROOM * mesh.piece_sizes[asked], asked, each=surface.runner.each)]
    points = representation.evaluate(np.repeat(far, len(GRID)), np.tile(GRID, (len(far), 1))).reshape(-1, len(GRID), 3)
    pieces, own, room = mesh.pieces, mesh.triangle_pieces[far], ROOM * mesh.piece_sizes[far][:, None]
    low, high = pieces.low[own] - room, pieces.high[own] + room
    out = ((points < low[:, None]) | (points > high[:, None])).any(axis=(1, 2))
    result = np.zeros(len(mesh.triangles), dtype=bool)
    result[far[out]] = True
    return result

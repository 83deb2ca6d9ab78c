"""Creases between wide smooth sides, found where a first pass of patches has removed most of the noise.

Filtered normals tell the sides of a crease apart as well as the noise lets them.  The mesh after a first pass tells
more.  What finds creases for a fit is asked there (see `FindCreases`): on wide sides its evidence is right, in relief
it takes folds for creases.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array, Booleans, any_of
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import FINISH, Progress, Steps, relayed
from .surface import Surface

FindCreases = Callable[[TriangleMesh, Booleans], Steps[tuple[Booleans, bool]]]
"""Finds the edges, (E,), on creases between some triangles, (T,), of a mesh; and says whether `FINISH` was sent."""


def no_creases(mesh: TriangleMesh, triangles: Booleans) -> Steps[tuple[Booleans, bool]]:
    """Find none."""
    yield from ()
    return np.zeros(len(mesh.edges), dtype=bool), False


@dataclass(frozen=True, eq=False)
class Sides:
    """The mesh cut along the creases between wide sides.

    Attributes
    ----------
    surface
        The cut mesh.
    triangles, vertices
        Triangles that touch a crease, (T,), and their vertices, (V,).
    hurry
        Whether `FINISH` was sent.
    """

    surface: Surface
    triangles: Booleans
    vertices: Booleans
    hurry: bool

    @property
    def found(self) -> bool:
        """Whether there are creases."""
        return bool(self.triangles.any())


def cut_between(
    surface: Surface, wide: Booleans, find_creases: FindCreases, vertices: Callable[[], Array]
) -> Steps[Sides]:
    """Cut the mesh along the creases between its wide sides.

    Parameters
    ----------
    surface
        The mesh.
    wide
        Triangles on wide smooth sides, (T,).
    find_creases
        What finds them.
    vertices
        Computes where the first patches place the vertices, (V, 3).
    """
    mesh = surface.mesh
    if (yield Progress("Finding creases", 0.0, surface=vertices)) == FINISH:
        return Sides(surface, np.zeros(len(wide), dtype=bool), np.zeros(len(mesh.vertices), dtype=bool), hurry=True)
    mesh = replace(mesh, vertices=vertices())
    searching = relayed(
        find_creases(mesh, wide), lambda step: Progress("Finding creases", step.fraction, surface=vertices)
    )
    creases, hurry = yield from searching
    touched = np.zeros(len(mesh.vertices), dtype=bool)
    touched[mesh.node_vertex[mesh.edges[creases]]] = True
    triangles = any_of(touched[surface.triangles])
    touched[surface.triangles[triangles]] = True
    return Sides(surface.cut_along(creases) if creases.any() else surface, triangles, touched, hurry)

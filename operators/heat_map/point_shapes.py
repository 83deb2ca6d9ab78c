"""Visible points: a small octahedron for each, in its colour, for pictures and viewports."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from bpy.types import Object
from numpy.typing import NDArray

from ..data.colours import ColourScale
from ..data.meshes import triangle_mesh
from ..data.results import write_error

_CORNERS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float64)
_FACES = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])

SHARE_OF_SPACING = 0.3


def create_point_shapes(
    name: str,
    points: NDArray[np.floating[Any]],
    spacing: float,
    error: NDArray[np.floating[Any]] | None = None,
    scale: ColourScale | None = None,
) -> Object:
    """Make an object of small octahedra at points (P, 3), coloured by their errors (P,) where these are given.

    It is linked to no collection.
    """
    count = len(points)
    positions = (np.asarray(points, dtype=np.float64)[:, None] + SHARE_OF_SPACING * spacing * _CORNERS).reshape(-1, 3)
    triangles = (_FACES[None] + len(_CORNERS) * np.arange(count)[:, None, None]).reshape(-1, 3)
    made = bpy.data.objects.new(name, triangle_mesh(name, positions, triangles))
    if error is not None and scale is not None:
        write_error(made, np.repeat(error, len(_CORNERS)), scale)
    return made

"""What stands in a picture: objects as triangles, and from where they are seen.

The picture is 16 units wide and 9 high, with (0, 0) in its middle.  Its own axes point right, up, and towards the
viewer, who sees without perspective.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from bpy.types import Mesh, Object
from numpy.typing import NDArray

from ..data.attributes import KINDS, fetch, read
from ..data.meshes import read_polygons, read_positions
from ..data.result_keys import ERROR_COLOUR

Array = NDArray[np.floating[Any]]

WIDTH, HEIGHT = 16.0, 9.0

CLAY = (0.36, 0.36, 0.37)


@dataclass(frozen=True)
class View:
    """From where the objects are seen.

    Attributes
    ----------
    axes
        The picture's axes in the world, (3, 3): right, up, towards the viewer.
    """

    axes: Array

    @classmethod
    def three_quarter(cls, azimuth: float = -35.0, elevation: float = 24.0) -> View:
        """Look from the front right and above (angles in degrees; z is up)."""
        a, e = np.radians(azimuth), np.radians(elevation)
        out = np.array([-np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), np.sin(e)])
        right = np.array([np.cos(a), -np.sin(a), 0.0])
        return cls(np.array([right, np.cross(out, right), out]))


@dataclass(frozen=True)
class Body:
    """An object as triangles between the corners of its faces.

    Attributes
    ----------
    vertices
        Positions (V, 3), of loose vertices too.
    corner_vertices
        The vertex of each corner, (C,).
    triangles
        Corners of the triangles, (T, 3).
    normals
        Of the corners, (C, 3).
    colours
        Of the corners, linear (C, 3).
    """

    vertices: Array
    corner_vertices: NDArray[np.int32]
    triangles: NDArray[np.int32]
    normals: Array
    colours: Array

    def turned(self, turn: Array) -> Body:
        """Return the body after a rotation about the origin."""
        return Body(self.vertices @ turn.T, self.corner_vertices, self.triangles, self.normals @ turn.T, self.colours)

    def placed(self, scale: float, move: Array) -> Body:
        """Return the body scaled about the origin, then moved."""
        moved = scale * self.vertices + move
        return Body(moved, self.corner_vertices, self.triangles, self.normals, self.colours)


def read_body(shown: Object, *, heat_map: bool) -> Body:
    """Copy an object, as it is evaluated, in the world's coordinates; in its error colours or in clay."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    evaluated = shown.evaluated_get(depsgraph)
    mesh = bpy.data.meshes.new_from_object(evaluated, preserve_all_data_layers=True, depsgraph=depsgraph)
    try:
        place = np.array(shown.matrix_world, dtype=np.float64)
        corner_vertices = read_polygons(mesh)[0]
        mesh.calc_loop_triangles()
        return Body(
            read_positions(mesh) @ place[:3, :3].T + place[:3, 3],
            corner_vertices,
            fetch(mesh.loop_triangles, "loops", np.int32, 3),
            fetch(mesh.corner_normals, "vector", np.float32, 3) @ np.linalg.pinv(place[:3, :3]),
            _colours(mesh, corner_vertices) if heat_map else _clay(len(corner_vertices)),
        )
    finally:
        bpy.data.meshes.remove(mesh)


def _colours(mesh: Mesh, corner_vertices: NDArray[np.int32]) -> Array:
    """Return the error colour of each corner, (C, 3); clay where the mesh has lost them."""
    layer = mesh.attributes.get(ERROR_COLOUR)
    if layer is None or KINDS[layer.data_type].width != 4 or layer.domain not in ("POINT", "CORNER"):
        return _clay(len(corner_vertices))
    colours = read(mesh, ERROR_COLOUR)[:, :3]
    return colours[corner_vertices] if layer.domain == "POINT" else colours


def _clay(count: int) -> Array:
    return np.tile(np.array(CLAY, dtype=np.float32), (count, 1))

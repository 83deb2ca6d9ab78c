"""Meshes, point clouds and representations as surfaces in the world, between which distances are measured."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np
from bpy.types import Depsgraph, Object
from numpy.typing import NDArray

from ...solver.arrays import offsets_of
from ...solver.distance.surface_pair import SurfacePair
from ...solver.distance.surfaces import Surface
from ...solver.errors import FileFormatError, InputError
from ...solver.mesh.triangulation import triangulate
from ...solver.surface.representation import Representation
from ...solver.surface.resampling import resample
from ..data.meshes import read_polygons, read_positions, read_triangles, to_world
from ..data.points import local_points
from ..data.result_keys import cut_name
from ..files.meshes import read_objects
from ..files.points import TEXT, read_points

REPRESENTATION_SPLITS = 4
"""Into how many parts the edges of a representation's mesh are split before it is measured."""


@dataclass(frozen=True)
class Measurable:
    """A mesh or a point cloud in world coordinates.

    Attributes
    ----------
    name
        Of the object or the file.
    vertices
        (V, 3).
    corners, sizes
        Vertex of each polygon corner, (C,), and corners of each polygon, (F,); none in a point cloud.
    triangles
        The polygons cut into triangles, (T, 3).
    """

    name: str
    vertices: NDArray[np.float64]
    corners: NDArray[np.int32]
    sizes: NDArray[np.int32]

    triangles: NDArray[np.int64]

    @property
    def surface(self) -> Surface:
        """What the solver measures; InputError where there is nothing to measure."""
        return Surface.of(self.vertices, self.triangles)


@dataclass(frozen=True)
class PairSource:
    """Two objects at the time when they were read: names, session numbers, what the solver gets."""

    name: str
    session_uid: int
    other_name: str
    other_uid: int
    measured: Measurable
    arrays: SurfacePair


def read_pair(active: Object, other: Object, depsgraph: Depsgraph) -> PairSource:
    """Read two objects; raises what `read_measurable` does."""
    one, two = (read_measurable(each, depsgraph) for each in (active, other))
    named = replace(one, name=cut_name(active.name, " Distance"))
    pair = SurfacePair(one.vertices, one.triangles, two.vertices, two.triangles)
    return PairSource(active.name, active.session_uid, other.name, other.session_uid, named, pair)


def read_measurable(source: Object, depsgraph: Depsgraph) -> Measurable:
    """Read an object after modifiers.

    Raises
    ------
    InputError
        When it is neither a mesh nor a point cloud, or has no points.
    """
    vertices = to_world(source, local_points(source, depsgraph))
    if not len(vertices):
        raise InputError(f"'{source.name}' has no points.")
    corners = sizes = np.zeros(0, dtype=np.int32)
    triangles = np.zeros((0, 3), dtype=np.int64)
    if source.type == "MESH":
        evaluated = source.evaluated_get(depsgraph)
        mesh = evaluated.to_mesh()
        corners, sizes = read_polygons(mesh)
        triangles = read_triangles(mesh, read_positions(mesh), corners, sizes)[0].astype(np.int64)
        evaluated.to_mesh_clear()
    return Measurable(source.name, vertices, corners, sizes, triangles)


def read_file(path: Path) -> Measurable:
    """Read all meshes and points of a file, or a representation, as one surface; replaces the open scene.

    Raises
    ------
    InputError
        When the file is missing or holds none.
    FileFormatError
        When it cannot be read.
    """
    if path.suffix.lower() == ".npz":
        fine = resample(Representation.load(path), REPRESENTATION_SPLITS)
        corners, sizes = fine.corners.astype(np.int32), fine.sizes.astype(np.int32)
        vertices = fine.vertices.astype(np.float64)
        triangles = triangulate(vertices, corners.astype(np.int64), offsets_of(sizes.astype(np.int64)))[0]
        return Measurable(path.stem, vertices, corners, sizes, triangles)
    try:
        found = read_objects(path, ("MESH", "POINTCLOUD"), "mesh and no point cloud")
    except (InputError, FileFormatError):
        if path.suffix.lower() not in TEXT or not path.is_file():
            raise
        found = [read_points(path)]
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    parts = [read_measurable(each, depsgraph) for each in found]
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    corners = np.concatenate([part.corners + start for part, start in zip(parts, first[:-1], strict=True)])
    triangles = np.concatenate([part.triangles + start for part, start in zip(parts, first[:-1], strict=True)])
    vertices, sizes = (np.concatenate([getattr(part, name) for part in parts]) for name in ("vertices", "sizes"))
    return Measurable(path.stem, vertices, corners.astype(np.int32), sizes, triangles)

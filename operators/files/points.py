"""Point clouds from files: those that Blender reads, and two kinds that it reads without their loose points."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from bpy.types import Object
from numpy.typing import NDArray

from ...solver.errors import FileFormatError
from ...solver.reconstruction.cleaning import far_origin
from ...solver.reconstruction.thinning import ThinCloud
from ..data import meshes as mesh_data
from ..data import points as cloud_data
from ..data.attributes import write
from ..data.colours import srgb_to_linear
from ..data.points import COLOURS, NORMALS
from ..data.result_keys import SHIFT
from .formats import POINTS
from .meshes import named, read_meshes, read_objects
from .point_files import READERS, PointFile, read_point_file
from .point_rows import Meaning

TEXT = (*READERS, ".obj")
"""Files that are read here: Blender has no importer for most, and drops the loose points of the last."""


def read_points(path: Path, name: str | None = None, *, shift: bool = False) -> Object:
    """Read a file into an empty scene and return one object with all of its points, or of those of one object.

    With `shift`, points far from the origin are moved there in double precision; `SHIFT` of the object says how far.

    Raises
    ------
    InputError
        When the file is missing, holds no points, or has no object of that name.
    FileFormatError
        When it cannot be read.
    """
    ending = path.suffix.lower()
    if path.is_file() and ending not in POINTS:
        raise FileFormatError(f"'{path.name}' is not a kind of file that can be read ({', '.join(POINTS)}).")
    if ending in TEXT and path.is_file():
        points = read_point_file(path)  # before the scene is emptied: a bad file changes nothing
        bpy.ops.wm.read_homefile(use_empty=True)
        return _object_of(path.stem, points, shift)
    found = named(read_objects(path, ("MESH", "POINTCLOUD"), "mesh and no point cloud"), name)
    if len(found) == 1:
        return found[0]
    return new_object(path.stem, np.concatenate([_world_points(each) for each in found]))


def read_base(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int32]]:
    """Read a file and return all of its meshes as one: world positions (V, 3), corners (C,), corners of each face (F,).

    Raises
    ------
    InputError
        When the file is missing or holds no mesh.
    FileFormatError
        When it cannot be read.
    """
    positions, corners, sizes, count = [], [], [], 0
    for each in read_meshes(path):
        own, numbers = mesh_data.read_polygons(each.data)
        positions.append(_world_points(each))
        corners.append(own + count)
        sizes.append(numbers)
        count += len(positions[-1])
    return np.concatenate(positions), np.concatenate(corners).astype(np.int32), np.concatenate(sizes)


def create_base(
    vertices: NDArray[np.float64], corners: NDArray[np.int32], sizes: NDArray[np.int32], name: str
) -> Object:
    """Put what `read_base` returned into the scene, hidden from renders."""
    mesh = mesh_data.create_mesh(name, vertices, corners, sizes)
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    made.hide_render = True
    return made


def _world_points(each: Object) -> NDArray[np.float64]:
    bpy.context.view_layer.update()
    return mesh_data.to_world(each, cloud_data.local_points(each, bpy.context.evaluated_depsgraph_get()))


def import_points(path: Path, *, shift: bool = False) -> Object:
    """Read a file of points only into the scene; raises and shifts as `read_points` does."""
    return _object_of(path.stem, read_point_file(path), shift)


def thin_object(name: str, thin: ThinCloud, meaning: Meaning) -> Object:
    """Put what thinning left of a file into an empty scene, as `read_points` does with all of it and `shift`."""
    bpy.ops.wm.read_homefile(use_empty=True)
    top = meaning.top
    colours = None if thin.colours is None or top is None else thin.colours / top
    return _object(name, PointFile(thin.points, colours, thin.normals if meaning.normals else None), thin.origin)


def _object_of(name: str, found: PointFile, shift: bool) -> Object:
    origin = far_origin(found.points) if shift else np.zeros(3)
    return _object(name, replace(found, points=found.points - origin), origin)


def _object(name: str, found: PointFile, origin: NDArray[np.float64]) -> Object:
    """Put points with their colours and normals into the scene; `origin` was subtracted from them."""
    made = new_object(name, found.points)
    if origin.any():
        made[SHIFT] = [float(value) for value in origin]
    if found.colours is not None:
        colours = np.concatenate([srgb_to_linear(found.colours), np.ones((len(found.colours), 1))], axis=1)
        write(made.data, {COLOURS: colours}, {COLOURS: ("FLOAT_COLOR", "POINT")})
    if found.normals is not None:
        write(made.data, {NORMALS: found.normals}, {NORMALS: ("FLOAT_VECTOR", "POINT")})
    return made


def new_object(name: str, points: NDArray[np.float64]) -> Object:
    """Put points (N, 3) into the scene, as a mesh of nothing but vertices."""
    none = np.zeros(0, dtype=np.int32)
    made = bpy.data.objects.new(name, mesh_data.create_mesh(name, points, none, none))
    bpy.context.scene.collection.objects.link(made)
    bpy.context.view_layer.update()
    return made

"""The bridge between point clouds with their bases and arrays."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Depsgraph, Object
from numpy.typing import NDArray

from ...solver.errors import InputError
from ...solver.interchange import CloudArrays
from ...solver.settings import CloudSettings
from .attributes import own_colours, read
from .meshes import WorldLengths, check_is_mesh, read_polygons, read_positions
from .result_keys import SHIFT

COLOURS = "Col"
"""Colours of points read from a file that holds no names."""

NORMALS = "normal"
"""What Blender calls the normals of a .ply file's points."""


@dataclass(frozen=True)
class CloudSource:
    """A point cloud with its base at the time when they were read.

    Attributes
    ----------
    name, session_uid
        Identify the points' object later: the name in messages, the number in spite of renaming and undo.
    arrays
        Points and base in the points' own axes, stretched to world lengths.
    lengths
        Leads from local positions to those of `arrays`.
    """

    name: str
    session_uid: int
    arrays: CloudArrays
    lengths: WorldLengths


def read_points(source: Object, depsgraph: Depsgraph) -> tuple[NDArray[np.float32], WorldLengths]:
    """Return the points of an object, after modifiers, stretched to world lengths, (P, 3), and that stretch.

    Raises
    ------
    InputError
        When it has none.
    """
    lengths = WorldLengths.of_matrix(source.evaluated_get(depsgraph).matrix_world)
    return lengths.from_local(local_points(source, depsgraph)), lengths


def local_points(source: Object, depsgraph: Depsgraph) -> NDArray[np.float32]:
    """Return the local positions of a mesh's vertices or a cloud's points, after modifiers, (P, 3).

    Raises
    ------
    InputError
        When the object is neither.
    """
    if source.mode == "EDIT":
        source.update_from_editmode()
    evaluated = source.evaluated_get(depsgraph)
    if source.type == "MESH":
        points = read_positions(evaluated.to_mesh())
        evaluated.to_mesh_clear()
        return points
    if source.type == "POINTCLOUD":
        cloud = evaluated.data
        return read(cloud, "position") if "position" in cloud.attributes else np.zeros((0, 3), dtype=np.float32)
    raise InputError(rpt_("'{}' has no points: select a mesh or a point cloud.").format(source.name))


def read_cloud(
    context: Context, points: Object, base: Object | None, base_vertices: int, cloud: CloudSettings, splits: int
) -> CloudSource:
    """Read points and base; where none is given, what solves makes one.

    Parameters
    ----------
    base_vertices
        Wanted number of vertices of a base that is made; 0: one for every 24 points, in noisy clouds for every 36.
    splits
        Number of parts of every edge of the base where the surface is evaluated; 0: by the number of points.

    Raises
    ------
    InputError
        When an object has no points, or the base no faces.
    """
    depsgraph = context.evaluated_depsgraph_get()
    positions, lengths = read_points(points, depsgraph)
    if base is None:
        arrays = CloudArrays.of_points(positions, cloud, splits, base_vertices)
    else:
        arrays = CloudArrays(positions, *_read_base(base, points, lengths, depsgraph), cloud, splits)
    x, y, z = points.get(SHIFT, (0.0, 0.0, 0.0))
    normals = _normals(points, len(positions), lengths)
    arrays = replace(arrays, shift=(x, y, z), colours=_colours(points, len(positions)), normals=normals)
    return CloudSource(points.name, points.session_uid, arrays, lengths)


def _colours(points: Object, count: int) -> NDArray[np.float32] | None:
    """Colours that the user's points have, linear (P, 4)."""
    if points.type != "MESH":
        return None
    for name in own_colours(points.data):
        if points.data.color_attributes[name].domain == "POINT" and len(points.data.vertices) == count:
            return read(points.data, name)
    return None


def _normals(points: Object, count: int, lengths: WorldLengths) -> NDArray[np.float32] | None:
    """Normals that a file or the user gave the points, in the axes of `CloudArrays`, (P, 3)."""
    if points.type not in ("MESH", "POINTCLOUD"):
        return None
    layer = points.data.attributes.get(NORMALS)
    if layer is None or (layer.data_type, layer.domain, len(layer.data)) != ("FLOAT_VECTOR", "POINT", count):
        return None
    return lengths.to_local(read(points.data, NORMALS))  # a stretch of points shortens normals


def _read_base(
    base: Object, points: Object, lengths: WorldLengths, depsgraph: Depsgraph
) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.int32]]:
    """Read a base, after modifiers: positions in the points' axes (V, 3), corners (C,), corners of each face (F,).

    Raises
    ------
    InputError
        When it is not a mesh, or has no faces.
    """
    check_is_mesh(base)
    if base.mode == "EDIT":
        base.update_from_editmode()
    evaluated = base.evaluated_get(depsgraph)
    mesh = evaluated.to_mesh()
    try:
        local = read_positions(mesh).astype(np.float64)
        corners, sizes = read_polygons(mesh)
    finally:
        evaluated.to_mesh_clear()
    if not len(sizes):
        raise InputError(rpt_("The base '{}' has no faces.").format(base.name))
    between = np.array(points.evaluated_get(depsgraph).matrix_world.inverted() @ evaluated.matrix_world)
    placed = local @ between[:3, :3].T + between[:3, 3]
    return lengths.from_local(placed.astype(np.float32)), corners, sizes

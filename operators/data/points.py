"""The bridge for point clouds: points and base objects to arrays, a reconstruction to objects."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Depsgraph, Mesh, Object
from numpy.typing import NDArray

from ...solver.errors import InputError
from ...solver.interchange import CloudArrays
from . import meshes as mesh_data
from .meshes import WorldLengths
from .result_keys import (
    DOMAIN_STRETCH,
    ERROR,
    ERROR_COLOUR,
    MADE_FROM,
    PATCH,
    REPORT,
    SPLITS,
    WEIGHT,
    cut_name,
    result_name,
)

if TYPE_CHECKING:
    from ...solver.interchange import CloudOutcome
    from .base_mesh import Base
    from .colours import ColourScale


@dataclass(frozen=True)
class CloudSource:
    """A point cloud with its base as they were when they were read.

    Attributes
    ----------
    name, session_uid
        Identify the points' object later; the name for messages, the number through renaming and undo.
    arrays
        Points and base in the points' own axes, stretched to world lengths.
    lengths
        Leads from local positions to those of `arrays`.
    made_base
        Whether the base was made from the points, and not chosen.
    """

    name: str
    session_uid: int
    arrays: CloudArrays
    lengths: WorldLengths
    made_base: bool


def read_points(source: Object, depsgraph: Depsgraph) -> tuple[NDArray[np.float32], WorldLengths]:
    """Return the points of an object, after modifiers, stretched to world lengths, (P, 3), and that stretch.

    Raises
    ------
    InputError
        When it has none.
    """
    if source.mode == "EDIT":
        source.update_from_editmode()
    evaluated = source.evaluated_get(depsgraph)
    lengths = WorldLengths.of_matrix(evaluated.matrix_world)
    if source.type == "MESH":
        points = mesh_data.read_positions(evaluated.to_mesh())
        evaluated.to_mesh_clear()
    elif source.type == "POINTCLOUD":
        points = _attribute_positions(evaluated.data)
    else:
        raise InputError(rpt_("'{}' has no points: select a mesh or a point cloud.").format(source.name))
    return lengths.from_local(points), lengths


def _attribute_positions(cloud: Any) -> NDArray[np.float32]:
    layer = cloud.attributes.get("position")
    points = np.empty(3 * (len(layer.data) if layer is not None else 0), dtype=np.float32)
    if layer is not None:
        layer.data.foreach_get("vector", points)
    return points.reshape(-1, 3)


@dataclass(frozen=True)
class BaseArrays:
    """A base in the axes and lengths of the points: positions (V, 3), corners (C,), corners of each polygon (F,)."""

    vertices: NDArray[np.float32]
    corners: NDArray[np.int32]
    sizes: NDArray[np.int32]


def read_base(base: Object, points: Object, lengths: WorldLengths, depsgraph: Depsgraph) -> BaseArrays:
    """Read a base object, after modifiers, in the axes of the points' object.

    Raises
    ------
    InputError
        When it is no mesh, or has no faces.
    """
    mesh_data.check_is_mesh(base)
    if base.mode == "EDIT":
        base.update_from_editmode()
    evaluated = base.evaluated_get(depsgraph)
    mesh = evaluated.to_mesh()
    try:
        local = mesh_data.read_positions(mesh).astype(np.float64)
        corners, sizes = mesh_data.read_polygons(mesh)
    finally:
        evaluated.to_mesh_clear()
    if not len(sizes):
        raise InputError(rpt_("The base '{}' has no faces.").format(base.name))
    between = np.array(points.evaluated_get(depsgraph).matrix_world.inverted() @ evaluated.matrix_world)
    placed = local @ between[:3, :3].T + between[:3, 3]
    return BaseArrays(lengths.from_local(placed.astype(np.float32)), corners, sizes)


def base_arrays(base: Base) -> BaseArrays:
    """Return a base that was made from points, which is in their axes already."""
    sizes = np.full(len(base.triangles), 3, dtype=np.int32)
    return BaseArrays(base.vertices.astype(np.float32), base.triangles.astype(np.int32).ravel(), sizes)


def create_surface(
    context: Context, source: CloudSource, result: CloudOutcome, scale: ColourScale, replace: bool = False
) -> Object:
    """Make the object of a reconstructed surface, in the place of the points.

    With `replace`, the surface that was made of these points before gets the new mesh instead.

    Raises
    ------
    InputError
        When the points were deleted meanwhile.
    """
    points = _points_object(source)
    name = result_name(points.name)
    mesh = mesh_data.create_mesh(name, source.lengths.to_local(result.vertices), result.corners, result.sizes)
    _shade_smooth(mesh)
    made = _object_of(context, points, name, mesh, replace)
    made[REPORT] = json.loads(json.dumps(result.report))  # plain values only, as Blender stores them
    made[SPLITS] = [result.splits, len(result.vertices), len(result.sizes)]
    mesh_data.store_representation(made, result.representation.stored, source.lengths)
    layers: dict[str, NDArray[Any]] = {
        ERROR: result.error,
        ERROR_COLOUR: scale.colours(result.error),
        PATCH: result.patch,
        DOMAIN_STRETCH: result.domain_stretch,
    }
    mesh_data.write_layers(mesh, layers)
    mesh_data.store_scale(made, scale)
    return made


def create_point_errors(
    context: Context, source: CloudSource, result: CloudOutcome, scale: ColourScale, replace: bool = False
) -> Object:
    """Make an object of the points alone, each with its error, its colour and its weight."""
    points = _points_object(source)
    name = cut_name(points.name, " Point Errors")
    none = np.zeros(0, dtype=np.int32)
    mesh = mesh_data.create_mesh(name, source.lengths.to_local(source.arrays.points), none, none)
    made = _object_of(context, points, name, mesh, replace)
    weight = mesh.attributes.new(WEIGHT, "FLOAT", "POINT")
    weight.data.foreach_set("value", result.point_weight.astype(np.float32))
    mesh_data.write_layers(mesh, {ERROR: result.point_error, ERROR_COLOUR: scale.colours(result.point_error)})
    mesh_data.store_scale(made, scale)
    return made


def create_base(context: Context, source: CloudSource, replace: bool = False) -> Object:
    """Make an object of the base that was made from the points."""
    points = _points_object(source)
    name = cut_name(points.name, " Base")
    arrays = source.arrays
    mesh = mesh_data.create_mesh(name, source.lengths.to_local(arrays.base_vertices), arrays.corners, arrays.sizes)
    made = _object_of(context, points, name, mesh, replace)
    made.display_type = "WIRE"
    made.hide_render = True
    return made


def _object_of(context: Context, points: Object, name: str, mesh: Mesh, replace: bool) -> Object:
    """Put a mesh into a new object in the place of the points, or into the one that was made of them before."""
    earlier = bpy.data.objects.get(name) if replace else None
    if earlier is not None and earlier.type == "MESH" and MADE_FROM in earlier and earlier.library is None:
        made, old, earlier.data = earlier, earlier.data, mesh
        if old.users == 0:
            bpy.data.meshes.remove(old)
        mesh.name = name
    else:
        made = bpy.data.objects.new(name, mesh)
        mesh_data.link_beside(made, points, context)
    made[MADE_FROM] = points.name
    mesh_data.place_like(made, points)
    return made


def _points_object(source: CloudSource) -> Object:
    found = mesh_data.find_object(source.session_uid)
    if found is None:
        text = rpt_("'{}' was deleted while its surface was being reconstructed; the result is dropped.")
        raise InputError(text.format(source.name))
    return found


def _shade_smooth(mesh: Mesh) -> None:
    """Shade faces smoothly where they meet at less than 30 degrees: creases stay sharp."""
    mesh.polygons.foreach_set("use_smooth", np.ones(len(mesh.polygons), dtype=bool))
    mesh.set_sharp_from_angle(angle=np.radians(30.0))

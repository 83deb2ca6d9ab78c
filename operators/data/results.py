"""The one door to results: what the solver brings back becomes an object with attributes, report and representation."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Mesh, Object
from numpy.typing import NDArray

from ...solver.errors import InputError
from . import attributes
from .colours import ColourScale
from .meshes import (
    Source,
    WorldLengths,
    create_mesh,
    mark_sharp,
    read_positions,
    same_topology,
    set_positions,
    vertex_areas,
)
from .objects import create_object, find_object
from .origins import BASE, POINT_ERRORS, RESULT
from .points import COLOURS
from .result_keys import (
    DOMAIN_STRETCH,
    ERROR,
    ERROR_COLOUR,
    MADE_FROM,
    NOISY_POSITION,
    PATCH,
    REPORT,
    SCALE,
    SHARES,
    SHIFT,
    SPLITS,
    STRETCH,
    WEIGHT,
    cut_name,
    forget_representation,
    result_name,
    store_representation,
)
from .shape_keys import add_iteration_keys
from .visibility import readable

if TYPE_CHECKING:
    from ...solver.approximation.result import Approximation
    from ...solver.interchange import CloudOutcome
    from .points import CloudSource


def create_result(
    context: Context,
    source: Source,
    result: Approximation,
    scale: ColourScale,
    *,
    role: str = RESULT,
    replace: bool = False,
    keeps_functions: bool = True,
) -> Object:
    """Make the result object: a copy of the source's mesh with moved vertices, attributes and report.

    With `replace`, what the same source had in this `role` before gets the new mesh instead.  Without
    `keeps_functions` the object holds no representation.

    Raises
    ------
    InputError
        When the source was removed or edited since it was read.
    """
    made_from, mesh = copy_source(source, context)
    name = mesh.name = result_name(made_from.name)
    before = read_positions(mesh) if _is_only_denoised(result.report) else None
    set_positions(mesh, source.lengths.to_local(result.vertices))
    made = create_object(name, mesh, made_from, context, role=role, replace=replace)
    _rename_groups(made)
    if before is not None:
        attributes.write(mesh, {NOISY_POSITION: before})
    if result.history is not None:
        add_iteration_keys(made, np.stack([source.lengths.to_local(points) for points in result.history]))
    _put(made, source, result, scale, keeps_functions)
    if result.creases is not None:
        mark_sharp(mesh, result.creases)
    return made


def create_unmeasured(context: Context, source: Source, vertices: NDArray[np.floating[Any]]) -> Object:
    """Make an object of a surface of which nothing but its vertices (V, 3) is known; raises as `create_result`."""
    made_from, mesh = copy_source(source, context)
    mesh.name = result_name(made_from.name)
    set_positions(mesh, source.lengths.to_local(vertices))
    return create_object(mesh.name, mesh, made_from, context, role=RESULT)


def create_surface(
    context: Context,
    source: CloudSource,
    result: CloudOutcome,
    scale: ColourScale,
    *,
    replace: bool = False,
    keeps_functions: bool = True,
) -> Object:
    """Make the object of a reconstructed surface, in the place of the points.

    With `replace`, an earlier surface of the same points gets the new mesh instead.  Without `keeps_functions` the
    object holds no representation.

    Raises
    ------
    InputError
        When the points were deleted meanwhile.
    """
    points = _points_object(source)
    name = result_name(points.name)
    mesh = create_mesh(name, source.lengths.to_local(result.vertices), result.corners, result.sizes)
    _shade_smooth(mesh)
    made = _beside_points(context, points, name, mesh, RESULT, replace)
    if result.colours is not None:
        attributes.write(mesh, {COLOURS: result.colours}, {COLOURS: ("FLOAT_COLOR", "POINT")})
    if SHIFT in points:
        made[SHIFT] = list(points[SHIFT])
    made[SPLITS] = [result.splits, len(result.vertices), len(result.sizes)]
    _put(made, source, result, scale, keeps_functions)
    return made


def create_point_errors(
    context: Context, source: CloudSource, result: CloudOutcome, scale: ColourScale, *, replace: bool = False
) -> Object:
    """Make an object of the points alone, each with its error, its colour and its weight."""
    points = _points_object(source)
    name = cut_name(points.name, " Point Errors")
    mesh = create_mesh(name, source.lengths.to_local(source.arrays.points))
    made = _beside_points(context, points, name, mesh, POINT_ERRORS, replace)
    attributes.write(mesh, {WEIGHT: result.point_weight})
    write_error(made, result.point_error, scale)
    return made


def create_base(
    context: Context,
    source: CloudSource,
    vertices: NDArray[np.float32],
    triangles: NDArray[np.int32],
    *,
    replace: bool = False,
) -> Object:
    """Make an object of the base that was made from the points: positions (V, 3) and triangles (T, 3)."""
    points = _points_object(source)
    name = cut_name(points.name, " Base")
    sizes = np.full(len(triangles), 3, dtype=np.int32)
    mesh = create_mesh(name, source.lengths.to_local(vertices), triangles.ravel(), sizes)
    made = _beside_points(context, points, name, mesh, BASE, replace)
    made.display_type = "WIRE"
    made.hide_render = True
    return made


def write_error(coloured: Object, error: NDArray[np.floating[Any]], scale: ColourScale) -> None:
    """Write the errors (V,) of an object's vertices, their colours, and the scale for the legend."""
    attributes.write(coloured.data, {ERROR: error, ERROR_COLOUR: scale.colours(error)})
    coloured[SCALE] = [scale.low, scale.high, scale.tolerance]
    coloured[SHARES] = scale.shares(error, vertex_areas(coloured.data)).tolist()


def copy_source(source: Source, context: Context) -> tuple[Object, Mesh]:
    """Return the object that was read, and a copy of its mesh to become the result's.

    Raises
    ------
    InputError
        When the object was removed or edited since it was read.
    """
    made_from = find_object(source.session_uid)
    if made_from is None or made_from.type != "MESH":
        raise InputError(f"'{source.name}' was deleted while it was being approximated; its result is dropped.")
    if made_from.mode == "EDIT":
        made_from.update_from_editmode()
    with readable([made_from], context):
        mesh = _copy_mesh(made_from, source.evaluated, context)
    if not same_topology(source.arrays, mesh):
        bpy.data.meshes.remove(mesh)
        raise InputError(f"'{made_from.name}' was edited while it was being approximated; its result is dropped.")
    return made_from, mesh


def _copy_mesh(made_from: Object, evaluated: bool, context: Context) -> Mesh:
    """Copy the mesh with every layer, but without shape keys: they would move the vertices back."""
    if evaluated:
        depsgraph = context.evaluated_depsgraph_get()
        of = made_from.evaluated_get(depsgraph)
        mesh = bpy.data.meshes.new_from_object(of, preserve_all_data_layers=True, depsgraph=depsgraph)
    else:
        mesh = bpy.data.meshes.new_from_object(made_from)
    for index, slot in enumerate(made_from.material_slots[: len(mesh.materials)]):
        if slot.link == "OBJECT":
            mesh.materials[index] = slot.material
    return mesh


def _is_only_denoised(report: dict[str, Any]) -> bool:
    """Whether noise was removed, and nothing fitted afterwards."""
    return not report["patches"] and "denoise" in report and report["denoise"]["displacement"]["max"] > 0.0


def _put(
    made: Object,
    source: Source | CloudSource,
    surface: Approximation | CloudOutcome,
    scale: ColourScale,
    keeps_functions: bool = True,
) -> None:
    """Write attributes, report, representation and colour scale of a surface."""
    write_error(made, surface.error, scale)
    attributes.write(made.data, {PATCH: surface.patch, DOMAIN_STRETCH: surface.domain_stretch})
    made[REPORT] = json.loads(json.dumps(surface.report))  # plain values only, as Blender stores them
    forget_representation(made)
    if keeps_functions:
        store_representation(made, surface.representation.draft)
        store_stretch(made, source.lengths)


def store_stretch(made: Object, lengths: WorldLengths) -> None:
    """Note how a scaled source's lengths lead to those of its functions."""
    if lengths.stretch is not None:
        made[STRETCH] = [float(value) for value in lengths.stretch.ravel()]


def _rename_groups(made: Object) -> None:
    """Leave the names of the result's attributes free: Blender allows no attribute that is named as a vertex group."""
    for name in (ERROR, ERROR_COLOUR, PATCH, DOMAIN_STRETCH, NOISY_POSITION):
        if name in made.vertex_groups:
            made.vertex_groups[name].name = attributes.OF_USER.format(name)


def _beside_points(context: Context, points: Object, name: str, mesh: Mesh, role: str, replace: bool) -> Object:
    made = create_object(name, mesh, points, context, role=role, replace=replace)
    made[MADE_FROM] = points.name
    return made


def _points_object(source: CloudSource) -> Object:
    found = find_object(source.session_uid)
    if found is None:
        text = rpt_("'{}' was deleted while its surface was being reconstructed; the result is dropped.")
        raise InputError(text.format(source.name))
    return found


def _shade_smooth(mesh: Mesh) -> None:
    """Shade faces smoothly where they meet at less than 30 degrees: creases stay sharp."""
    attributes.put(mesh.polygons, "use_smooth", np.ones(len(mesh.polygons)), np.bool_)
    mesh.set_sharp_from_angle(angle=np.radians(30.0))

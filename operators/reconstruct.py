"""The operator that makes a surface of a point cloud, over a base that is chosen or made."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Object, Operator

from ..solver.errors import SparseSurfaceError
from .heat_map.scale import colour_scale
from .run import control as running
from .run.operator import Solved, Solving, Task, refusal, scene_settings
from .run.requirements import missing_packages

if TYPE_CHECKING:
    from ..solver.settings import CloudSettings
    from .data.points import CloudSource


class SPARSE_SURFACE_OT_reconstruct(Solving, Operator):
    """Make a surface of the active object's points: a mesh's vertices or a point cloud. The result is a new object"""

    bl_idname = "sparse_surface.reconstruct"
    bl_label = "Reconstruct"
    bl_options = {"UNDO"}
    has_preview = False

    @classmethod
    def poll(cls, context: Context) -> bool:
        reason = reason_against(context)
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def tasks(self, context: Context) -> tuple[list[Task], list[str]]:
        """The active points with the scene's settings."""
        chosen = points_object(context)
        if chosen is None:
            return [], [rpt_("Select a mesh or a point cloud")]
        wanted = context.scene.sparse_surface.reconstruction
        try:
            source = read_cloud(
                context, chosen, wanted.base, wanted.base_vertices, wanted.to_cloud_settings(), wanted.splits
            )
        except (SparseSurfaceError, MemoryError) as error:
            return [], [refusal(chosen.name, error, 1)]
        return [(source, scene_settings(context))], []

    def make_objects(self, context: Context, done: Sequence[Solved], refusals: list[str]) -> list[Object]:
        """The surface, the points with their errors, and the base if it is kept."""
        made = []
        for source, result in done:
            try:
                made.append(make_objects(context, source, result))
            except SparseSurfaceError as error:
                refusals.append(str(error))
            else:
                self._say(source.name, result.report)
        return made

    def _say(self, name: str, report: dict[str, Any]) -> None:
        error = report["surface_error"]
        text = rpt_("'{}': {} points, {} patches, error rms {:.3g}, max {:.3g}, {:.1f} s")
        self.report(
            {"INFO"},
            text.format(
                name,
                report["input"]["points"],
                report["patches"],
                error["rms"],
                error["max"],
                report["seconds"]["total"],
            ),
        )


def reason_against(context: Context) -> str:
    """Return why the button cannot be pressed, or nothing."""
    if missing_packages():
        return rpt_("{} is missing: install the add-on's zip for your platform, which brings it").format(
            " and ".join(missing_packages())
        )
    if running.current is not None:
        return rpt_("An approximation is running; wait for it or cancel it")
    if context.mode != "OBJECT":
        return rpt_("Switch to Object Mode first")
    if points_object(context) is None:
        return rpt_("Select a mesh or a point cloud other than the base")
    return ""


def points_object(context: Context) -> Object | None:
    """Return the object whose points are meant: the active one, or another selected one where that is the base."""
    base = context.scene.sparse_surface.reconstruction.base
    chosen = sorted(context.selected_objects, key=lambda o: (o != context.active_object, o.name))
    return next((o for o in chosen if o.type in {"MESH", "POINTCLOUD"} and o != base), None)


def read_cloud(
    context: Context, points: Object, base: Object | None, base_vertices: int, cloud: CloudSettings, splits: int
) -> CloudSource:
    """Read points and base; the base is made where none is given.

    Raises
    ------
    SparseSurfaceError
        When there are too few points, or no base can be made of them.
    """
    from ..solver.interchange import CloudArrays
    from ..solver.reconstruction.reconstruct import checked_points
    from .data import points as cloud_data
    from .data.base_mesh import make_base

    depsgraph = context.evaluated_depsgraph_get()
    positions, lengths = cloud_data.read_points(points, depsgraph)
    checked_points(positions)
    if base is None:
        arrays = cloud_data.base_arrays(make_base(positions, base_vertices))
    else:
        arrays = cloud_data.read_base(base, points, lengths, depsgraph)
    together = CloudArrays(positions, arrays.vertices, arrays.corners, arrays.sizes, cloud, splits)
    return cloud_data.CloudSource(points.name, points.session_uid, together, lengths, base is None)


def make_objects(context: Context, source: CloudSource, result: Any) -> Object:
    """Make the objects of a reconstruction and return the surface's.

    Raises
    ------
    InputError
        When the points were deleted meanwhile.
    """
    from .data import meshes as mesh_data
    from .data import points as cloud_data

    settings = context.scene.sparse_surface
    wanted, replace = settings.reconstruction, settings.replace_result
    scale = colour_scale(context.scene, result.point_error)
    surface = cloud_data.create_surface(context, source, result, scale, replace)
    if wanted.point_errors:
        cloud_data.create_point_errors(context, source, result, scale, replace)
    if wanted.keep_base and source.made_base:
        cloud_data.create_base(context, source, replace)
    original = mesh_data.find_object(source.session_uid)
    if settings.hide_original and original is not None:
        original.hide_set(True)
    return surface


CLASSES = (SPARSE_SURFACE_OT_reconstruct,)

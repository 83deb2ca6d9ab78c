"""The operator that evaluates a result's surface on a finer mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.props import IntProperty
from bpy.types import Context, Object, Operator

from ..solver.errors import SparseSurfaceError
from ..solver.settings import MOST_SPLITS
from .data.result_keys import SCALE, SPLITS, cut_name, has_representation
from .run import control as running

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..solver.surface.resampling import Resampled
    from .data.colours import ColourScale


class SPARSE_SURFACE_OT_resample(Operator):
    """Make a finer mesh of the active result's surface: every edge is split, quads stay quads, layers are kept"""

    bl_idname = "sparse_surface.resample"
    bl_label = "Resample"
    bl_options = {"REGISTER", "UNDO"}

    splits: IntProperty(
        name="Splits",
        description="Into how many parts every edge is split. The number of faces grows with its square",
        default=2,
        min=1,
        max=MOST_SPLITS,
        soft_max=8,
    )

    @classmethod
    def poll(cls, context: Context) -> bool:
        reason = reason_against(context)
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Context) -> set[str]:
        from .data import meshes as mesh_data

        holder = context.active_object
        try:
            made = resample_object(context, holder, self.splits)
        except (SparseSurfaceError, MemoryError) as error:
            self.report({"ERROR"}, str(error) or rpt_("There is not enough memory for so many faces."))
            return {"CANCELLED"}
        mesh_data.select_only(context, [made])
        mesh = made.data
        text = rpt_("'{}': {} vertices, {} faces")
        self.report({"INFO"}, text.format(made.name, len(mesh.vertices), len(mesh.polygons)))
        return {"FINISHED"}


def reason_against(context: Context) -> str:
    """Return why no representation can be worked with, or nothing."""
    if running.current is not None:
        return rpt_("An approximation is running; wait for it or cancel it")
    if context.mode != "OBJECT":
        return rpt_("Switch to Object Mode first")
    if not has_representation(context.active_object):
        return rpt_("Select a result: an object that Approximate has made")
    return ""


def resample_object(context: Context, holder: Object, splits: int) -> Object:
    """Make the resampled object of a result.

    Raises
    ------
    SparseSurfaceError
        When the object holds no representation, its mesh was edited, or the new one would be too large.
    """
    import numpy as np

    from ..solver.progress import run_to_end
    from ..solver.surface.resampling import resample_steps
    from .data import attributes as layers
    from .data import meshes as mesh_data
    from .data import representation as stored_representation

    representation = stored_representation.read(holder)
    place = stored_representation.placement(holder, representation)
    manager = context.window_manager
    manager.progress_begin(0.0, 1.0)
    try:
        resampled: Resampled = run_to_end(
            resample_steps(representation, splits), lambda step: manager.progress_update(step.fraction)
        )
    finally:
        manager.progress_end()
    name = cut_name(holder.name, " Resampled")
    on_source = SPLITS not in holder  # a reconstructed surface is finer than what its representation stands on
    loose = layers.loose_edges(holder.data) if on_source else None
    local = place.to_local(resampled.vertices)
    mesh = mesh_data.create_mesh(name, local, resampled.corners, resampled.sizes, loose)
    made = bpy.data.objects.new(name, mesh)
    mesh_data.link_beside(made, holder, context)
    mesh_data.place_like(made, holder)
    if on_source:
        layers.interpolate_layers(holder, made, resampled)
        error = np.linalg.norm(resampled.vertices - resampled.at_vertices.linear(representation.vertices), axis=1)
    else:
        error = _nearest_errors(holder, local)
    mesh_data.write_error(made, error, _colours_like(holder, context, error))
    return made


def _nearest_errors(holder: Object, local: NDArray[np.float32]) -> NDArray[np.float64]:
    """Errors at positions on a reconstructed surface: those of the nearest vertices of its mesh."""
    import numpy as np
    from scipy.spatial import cKDTree

    from .data import meshes as mesh_data

    nearest = cKDTree(mesh_data.read_positions(holder.data)).query(local)[1]
    return mesh_data.read_error(holder.data)[nearest].astype(np.float64)


def _colours_like(holder: Object, context: Context, error: NDArray[np.float64]) -> ColourScale:
    """Return the scale of the object that is resampled, so that both can be compared."""
    from .data.colours import ColourScale
    from .heat_map.scale import colour_scale

    return ColourScale(*holder[SCALE]) if SCALE in holder else colour_scale(context.scene, error)


CLASSES = (SPARSE_SURFACE_OT_resample,)

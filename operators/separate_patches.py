"""The operator that shows a result's patches one by one: each as an object of its own, not blended with the others."""

from __future__ import annotations

import colorsys
from typing import TYPE_CHECKING, Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Collection, Context, Object, Operator

from ..solver.errors import SparseSurfaceError
from .data.result_keys import cut_name
from .resample import reason_against

if TYPE_CHECKING:
    from ..solver.surface.representation import Representation

GAP = "gap"
"""Attribute of a patch's mesh: largest distance to another patch's point for the same vertex, in scene units."""

GOLDEN_RATIO = 0.618034


class SPARSE_SURFACE_OT_separate_patches(Operator):
    """Make an object of each patch of the active result as it is before blending, and measure the gaps between them"""

    bl_idname = "sparse_surface.separate_patches"
    bl_label = "Separate Patches"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Context) -> bool:
        reason = reason_against(context)
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Context) -> set[str]:
        from ..solver.surface.metrics import statistics

        try:
            patches, gaps = separate_patches(context, context.active_object)
        except SparseSurfaceError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        measured = statistics(gaps[gaps > 0.0])
        self.report(
            {"INFO"},
            rpt_("{} patches; gaps where they overlap: rms {:.3g}, max {:.3g}").format(
                len(patches.objects), measured["rms"], measured["max"]
            ),
        )
        return {"FINISHED"}


def separate_patches(context: Context, holder: Object) -> tuple[Collection, Any]:
    """Make an object of each patch, in a collection beside the result.

    Returns
    -------
    collection
        Of the patches, in their order.
    gaps
        Gap at each vertex of the result, (V,), scene units.

    Raises
    ------
    InputError
        When the object holds no representation, or its mesh was edited.
    """
    from ..solver.surface.overlaps import overlap_gaps
    from .data import representation as stored_representation

    representation = stored_representation.read(holder)
    place = stored_representation.placement(holder, representation)
    gaps = overlap_gaps(representation)
    points = place.to_local(representation.at_patch_vertices)
    collection = bpy.data.collections.new(cut_name(holder.name, " Patches"))
    context.scene.collection.children.link(collection)
    for patch in range(representation.patches):
        made = _patch_object(representation, points, gaps, patch, holder)
        collection.objects.link(made)
        made.matrix_world = holder.matrix_world
    return collection, gaps


def _patch_object(representation: Representation, points: Any, gaps: Any, patch: int, holder: Object) -> Object:
    import numpy as np

    from .data import meshes as mesh_data

    name = cut_name(holder.name, f" Patch {patch + 1}")
    vertices = slice(*representation.vertex_offsets[patch : patch + 2])
    triangles = representation.patch_triangles[slice(*representation.triangle_offsets[patch : patch + 2])]
    mesh = mesh_data.create_mesh(name, points[vertices], triangles.ravel(), np.full(len(triangles), 3))
    layer = mesh.attributes.new(GAP, "FLOAT", "POINT")
    layer.data.foreach_set("value", gaps[representation.patch_vertices[vertices]].astype(np.float32))
    made = bpy.data.objects.new(name, mesh)
    # Neighbouring numbers get hues far apart; the viewport shows them with Color: Object.
    made.color = (*colorsys.hsv_to_rgb(patch * GOLDEN_RATIO % 1.0, 0.55, 0.9), 1.0)
    return made


CLASSES = (SPARSE_SURFACE_OT_separate_patches,)

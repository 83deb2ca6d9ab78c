"""A result's patches as objects of their own, before blending, and the gaps between them."""

from __future__ import annotations

import colorsys

import bpy
import numpy as np
from bpy.types import Collection, Context, Object
from numpy.typing import NDArray

from ...solver.surface.metrics import statistics
from ...solver.surface.overlaps import overlap_gaps
from ...solver.surface.representation import Representation
from ..data import attributes
from ..data.meshes import triangle_mesh
from ..data.objects import remove_objects
from ..data.origins import PATCH, ROLE, made_from, note_origin
from ..data.result_keys import GAP, cut_name
from .stored import placement, read_representation

GOLDEN_RATIO = 0.618034


def separate_patches(context: Context, holder: Object) -> tuple[Collection, dict[str, float]]:
    """Make an object of each patch, in a collection beside the result.

    Returns
    -------
    collection
        Of the patches, in their order.
    gaps
        Statistics of the gaps at those vertices of the result that have one: rms, mean, p95, max; scene units.

    Raises
    ------
    InputError
        When the object holds no representation, or its mesh was edited.
    """
    representation = read_representation(holder)
    place = placement(holder, representation)
    gaps = overlap_gaps(representation)
    points = place.to_local(representation.at_patch_vertices)
    if context.scene.sparse_surface.replace_result:
        _remove_earlier(holder)
    collection = bpy.data.collections.new(cut_name(holder.name, " Patches"))
    context.scene.collection.children.link(collection)
    for patch in range(representation.patches):
        made = _patch_object(representation, points, gaps, patch, holder.name)
        collection.objects.link(made)
        made.matrix_world = holder.matrix_world
        note_origin(made, holder, PATCH)
    return collection, statistics(gaps[gaps > 0.0])


def _remove_earlier(holder: Object) -> None:
    """Remove the patches of an earlier separation, and the collections that this leaves empty."""
    patches = [made for made in made_from(holder) if made.get(ROLE) == PATCH]
    collections = {collection for patch in patches for collection in patch.users_collection}
    remove_objects(patches)
    for collection in collections:
        if collection != bpy.context.scene.collection and not (collection.objects or collection.children):
            bpy.data.collections.remove(collection)


def _patch_object(
    representation: Representation, points: NDArray[np.float32], gaps: NDArray[np.float64], patch: int, of: str
) -> Object:
    name = cut_name(of, f" Patch {patch + 1}")
    vertices = slice(*representation.vertex_offsets[patch : patch + 2])
    triangles = representation.patch_triangles[slice(*representation.triangle_offsets[patch : patch + 2])]
    mesh = triangle_mesh(name, points[vertices], triangles)
    attributes.write(mesh, {GAP: gaps[representation.patch_vertices[vertices]]})
    made = bpy.data.objects.new(name, mesh)
    # Hues of consecutive patches lie far apart; the viewport shows them with Color: Object.
    made.color = (*colorsys.hsv_to_rgb(patch * GOLDEN_RATIO % 1.0, 0.55, 0.9), 1.0)
    return made

"""One patch of a result laid out: its place on the surface, its domains flat, its functions over the domain."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Any

import bpy
import numpy as np
from bpy.app.translations import pgettext_iface as iface_
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Collection, Context, Object
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from ...solver.errors import InputError
from ...solver.surface.inspection import PatchSheet, patch_energy, patch_sheet, patch_terms
from ...solver.surface.representation import Representation
from ..data import attributes
from ..data.meshes import triangle_mesh
from ..data.result_keys import INSPECTED, INSPECTION, PATCH, PATCH_COLOUR, has_patches
from .clearing import clear_inspection
from .stored import placement, read_representation

FINE_SPLITS = 4
"""Parts of a triangle's edge where a patch's functions are shown."""

TILE, GAP, LABEL = 0.5, 0.2, 0.11
"""Width of a flat domain, the space around it, and the height of the words below, relative to the result's size."""


def choose_patch(context: Context, holder: Object, which: str) -> int:
    """Return the number of the patch to show.

    Parameters
    ----------
    which
        "CHOSEN": the one whose number the panel shows; "NEXT" or "PREVIOUS": the one after or before it, from the last
        to the first and back; "SELECTED": the one that counts most at most of the selected vertices.

    Raises
    ------
    SparseSurfaceError
        When the object holds no representation, has no patches, or no vertices are selected.
    """
    if which == "SELECTED":
        return _patch_at_selection(holder)
    inspection = context.scene.sparse_surface.inspection
    count = read_representation(holder).patches
    if not count:
        raise InputError(rpt_("'{}' has no patches: all of it passed through unchanged.").format(holder.name))
    if which == "CHOSEN" or inspection.holder != holder.name:
        return min(int(inspection.patch), count - 1)
    return (int(inspection.patch) + (1 if which == "NEXT" else -1)) % count


def _patch_at_selection(holder: Object) -> int:
    if not has_patches(holder):
        raise InputError(rpt_("'{}' does not say which patch counts most at a vertex.").format(holder.name))
    patch = attributes.read(holder.data, PATCH)
    chosen = patch[attributes.fetch(holder.data.vertices, "select", np.bool_) & (patch >= 0)]
    if not len(chosen):
        raise InputError(rpt_("Select vertices of '{}' in Edit Mode first.").format(holder.name))
    return int(np.bincount(chosen).argmax())


def inspect_patch(context: Context, holder: Object, patch: int) -> list[Object]:
    """Show a patch of a result in the place of what was shown before.

    Raises
    ------
    SparseSurfaceError
        When the object holds no representation, its mesh was edited, or there is no such patch.
    """
    representation = read_representation(holder)
    # Refuse before anything is cleared away.
    placement(holder, representation)
    patch_terms(representation, patch)
    clear_inspection(context)
    shown = lay_out_patch(context, holder, representation, patch)
    _note(context, holder, representation, patch)
    return shown


def lay_out_patch(context: Context, holder: Object, representation: Representation, patch: int) -> list[Object]:
    """Make the objects that show a patch of the representation of `holder`.

    Raises
    ------
    SparseSurfaceError
        When the object's mesh is not that of the representation, or there is no such patch.
    """
    place = placement(holder, representation)
    coarse = patch_sheet(representation, patch)
    fine = patch_sheet(representation, patch, FINE_SPLITS)
    collection = _collection(context)
    shown = _Shown(holder, patch, collection, _triangle_colours(representation, patch))
    on_surface = shown.add("", place.to_local(fine.values), fine)
    on_surface.matrix_world = holder.matrix_world
    on_surface.show_in_front = True
    _lay_out(shown, coarse, fine, context)
    return list(collection.objects)


def _collection(context: Context) -> Collection:
    collection = bpy.data.collections.get(INSPECTION) or bpy.data.collections.new(INSPECTION)
    if collection.name not in context.scene.collection.children:
        context.scene.collection.children.link(collection)
    return collection


@dataclass(frozen=True)
class _Shown:
    """Makes the objects of one patch; `colours` are RGBA for each of its triangles, (t, 4)."""

    holder: Object
    patch: int
    collection: Collection
    colours: NDArray[np.float32]

    def add(self, what: str, positions: NDArray[np.floating[Any]], sheet: PatchSheet) -> Object:
        """Make an object of positions (P, 3) of a sheet; every triangle has the colour of its place on the result."""
        name = f"Patch {self.patch} {what}".strip()
        mesh = triangle_mesh(name, positions, sheet.triangles)
        colours = np.repeat(self.colours[sheet.source], 3, axis=0)
        attributes.write(mesh, {PATCH_COLOUR: colours}, {PATCH_COLOUR: ("FLOAT_COLOR", "CORNER")})
        attributes.show_colours(mesh, PATCH_COLOUR)
        made = bpy.data.objects.new(name, mesh)
        made[INSPECTED] = self.holder.name
        self.collection.objects.link(made)
        return made

    def label(self, what: str, words: str, matrix: Matrix) -> None:
        """Write words, their lines 1 high, at a place."""
        made = bpy.data.objects.new(f"Patch {self.patch} {what} Label", bpy.data.curves.new(what, "FONT"))
        made.data.body = words
        made.matrix_world = matrix
        made.hide_select = made.show_in_front = True
        made[INSPECTED] = self.holder.name
        self.collection.objects.link(made)


def _triangle_colours(representation: Representation, patch: int) -> NDArray[np.float32]:
    """Colour of each of the patch's triangles by the direction that it faces, RGBA (t, 4): creases show as edges."""
    rows = slice(*representation.triangle_offsets[patch : patch + 2])
    corners = representation.vertices[representation.triangles[representation.mesh_triangles[rows]]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    return np.concatenate([0.5 + 0.45 * normal, np.ones((len(normal), 1))], axis=1).astype(np.float32)


def _lay_out(shown: _Shown, coarse: PatchSheet, fine: PatchSheet, context: Context) -> None:
    """Domains above the functions; with a domain for each coordinate, a row of domains and function for each.

    Views are wider than high, and so are both.
    """
    several = len(coarse.domains) > 1
    everything = np.concatenate([*coarse.initial_domains, *coarse.domains])
    extent = float(np.ptp(everything, axis=0).max())
    facing = view_axes(context)
    origin, size = _beside(shown.holder, facing, context)
    for d, axis in enumerate("xyz"):
        c = d if several else 0
        whose = f" {axis}" if several else ""
        column = []
        if several or d == 0:
            column.append((f"Initial Domain{whose}", _flat(coarse.initial_domains[c]), coarse))
            column.append((f"Optimised Domain{whose}", _flat(coarse.domains[c]), coarse))
        over_domain = np.concatenate([fine.domains[c], fine.heights[:, [d]]], axis=1)
        column.append((f"{axis}(u, v)", over_domain, fine))
        for kind, (what, positions, sheet) in zip((0, 1, 2)[-len(column) :], column, strict=True):
            made = shown.add(what, positions, sheet)
            made.show_wire = made.show_all_edges = sheet is coarse
            right, up = (kind, 2 - d) if several else ((kind, 1) if kind < 2 else (d, 0))
            corner = Vector((right * (TILE + GAP) + GAP / 2.0, up * (TILE + GAP + 2.0 * LABEL) + 2.0 * LABEL, 0.0))
            middle = corner + Vector((TILE / 2.0, TILE / 2.0, 0.0))
            scale = TILE * size / extent if extent > 0.0 else 1.0
            turned = facing if sheet is coarse or facing == _FROM_ABOVE else facing @ _TILT
            at = Matrix.Translation(facing @ (origin + middle * size))
            made.matrix_world = at @ turned.to_4x4() @ Matrix.Scale(scale, 4)
            title = (iface_("Initial Domain"), iface_("Optimised Domain"), f"{axis}(u, v)")[kind]
            words = title if sheet is fine else title.replace(" ", "\n", 1) + whose
            below = Matrix.Translation(facing @ (origin + (corner - Vector((0.0, LABEL, 0.0))) * size))
            shown.label(what, words, below @ facing.to_4x4() @ Matrix.Scale(LABEL * size, 4))


def _flat(domain: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([domain, np.zeros((len(domain), 1))], axis=1)


_FROM_ABOVE = Matrix.Identity(3)
_TILT = Matrix.Rotation(radians(-35.0), 3, "X")
"""Turns a function's graph so that its heights are seen."""


def view_axes(context: Context) -> Matrix:
    """Return the directions to the right, up and towards the user of the context's viewport, as columns, (3, 3).

    Without a viewport that is the view from above.
    """
    view = getattr(context, "region_data", None)
    return view.view_rotation.to_matrix() if view is not None else _FROM_ABOVE.copy()


def _beside(holder: Object, facing: Matrix, context: Context) -> tuple[Vector, float]:
    """Return the lower corner of the free space at the right of an object, along `facing`, and the object's size."""
    context.view_layer.update()
    to_view = facing.transposed()
    corners = [to_view @ (holder.matrix_world @ Vector(corner)) for corner in holder.bound_box]
    low, high = (Vector(tuple(pick(corner[k] for corner in corners) for k in range(3))) for pick in (min, max))
    size = max(high - low) or 1.0
    depth = low.z if facing == _FROM_ABOVE else (low.z + high.z) / 2.0
    return Vector((high.x + GAP * size, low.y, depth)), size


def _note(context: Context, holder: Object, representation: Representation, patch: int) -> None:
    """Note what the panel shows of the patch."""
    noted = context.scene.sparse_surface.inspection
    noted.holder, noted.patch = holder.name, patch
    noted.patches = representation.patches
    noted.vertices = int(representation.vertex_offsets[patch + 1] - representation.vertex_offsets[patch])
    for term in patch_terms(representation, patch):
        line = noted.terms.add()
        line.name, line.amounts = term.name, term.amounts
    for value in patch_energy(representation, patch):
        noted.energy.add().value = value

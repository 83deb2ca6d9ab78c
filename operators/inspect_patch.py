"""The operators that lay one patch of a result out to be looked at, step to the next, and clear it away."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.props import EnumProperty
from bpy.types import Collection, Context, Object, Operator
from mathutils import Matrix, Vector

from ..solver.errors import InputError, SparseSurfaceError
from .data.result_keys import PATCH, PATCH_COLOUR, remove_marked
from .resample import reason_against
from .show_patches import has_patches

if TYPE_CHECKING:
    from ..solver.surface.inspection import PatchSheet
    from ..solver.surface.representation import Representation

INSPECTED = "sparse_surface_inspected"
"""Custom property of what the inspection shows: the result's name. A pointer would keep a deleted one alive."""

COLLECTION = "Sparse Surface Inspection"

FINE_SPLITS = 4
"""Parts of a triangle's edge where a patch's functions are shown."""

TILE, GAP = 0.5, 0.15
"""Width of what is laid flat, and the space around it, in the result's size."""


class SPARSE_SURFACE_OT_inspect_patch(Operator):
    """Lay the patch's initial and optimised domains flat beside the result, with its functions over the domain"""

    bl_idname = "sparse_surface.inspect_patch"
    bl_label = "Inspect Patch"
    bl_options = {"REGISTER", "UNDO"}

    which: EnumProperty(
        name="Patch",
        items=[
            ("CHOSEN", "Chosen", "The patch whose number the panel shows"),
            ("NEXT", "Next", "The patch after it"),
            ("PREVIOUS", "Previous", "The patch before it"),
            ("SELECTED", "Selected", "The patch that counts most at the vertices selected in Edit Mode"),
        ],
        default="CHOSEN",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: Context) -> bool:
        reason = reason_against(context)
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def execute(self, context: Context) -> set[str]:
        holder = context.active_object
        try:
            patch = _chosen_patch(context, holder, self.which)
            inspect_patch(context, holder, patch)
        except SparseSurfaceError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        context.scene.sparse_surface.inspection.patch = patch
        return {"FINISHED"}


class SPARSE_SURFACE_OT_clear_inspection(Operator):
    """Remove the domains and functions that Inspect Patch has laid out"""

    bl_idname = "sparse_surface.clear_inspection"
    bl_label = "Clear Inspection"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Context) -> bool:
        if context.mode != "OBJECT":
            cls.poll_message_set("Switch to Object Mode first")
            return False
        return bool(context.scene.sparse_surface.inspection.holder) or COLLECTION in bpy.data.collections

    def execute(self, context: Context) -> set[str]:
        clear_inspection(context)
        return {"FINISHED"}


def _chosen_patch(context: Context, holder: Object, which: str) -> int:
    """Return the number of the patch to be shown; stepping goes around at both ends."""
    from .data import representation as stored_representation

    if which == "SELECTED":
        return _patch_at_selection(holder)
    inspection = context.scene.sparse_surface.inspection
    count = stored_representation.read(holder).patches
    if not count:
        raise InputError(rpt_("'{}' has no patches: all of it passed through unchanged.").format(holder.name))
    if which == "CHOSEN" or inspection.holder != holder.name:
        return min(int(inspection.patch), count - 1)
    return (int(inspection.patch) + (1 if which == "NEXT" else -1)) % count


def _patch_at_selection(holder: Object) -> int:
    """Return the patch that most of the selected vertices have."""
    import numpy as np

    mesh = holder.data
    if not has_patches(holder):
        raise InputError(rpt_("'{}' does not say which patch counts most at a vertex.").format(holder.name))
    selected, patch = np.empty(len(mesh.vertices), dtype=bool), np.empty(len(mesh.vertices), dtype=np.int32)
    mesh.vertices.foreach_get("select", selected)
    mesh.attributes[PATCH].data.foreach_get("value", patch)
    chosen = patch[selected & (patch >= 0)]
    if not len(chosen):
        raise InputError(rpt_("Select vertices of '{}' in Edit Mode first.").format(holder.name))
    return int(np.bincount(chosen).argmax())


def inspect_patch(context: Context, holder: Object, patch: int) -> list[Object]:
    """Show a patch of a result; what was shown before is removed.

    Raises
    ------
    SparseSurfaceError
        When the object holds no representation, its mesh was edited, or there is no such patch.
    """
    from ..solver.surface.inspection import patch_terms
    from .data import representation as stored_representation

    representation = stored_representation.read(holder)
    # What is refused is refused before anything is cleared away.
    stored_representation.placement(holder, representation)
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
    from ..solver.surface import inspection
    from .data import representation as stored_representation

    place = stored_representation.placement(holder, representation)
    coarse = inspection.patch_sheet(representation, patch)
    fine = inspection.patch_sheet(representation, patch, FINE_SPLITS)
    collection = _collection(context)
    shown = _Shown(holder, patch, collection, _triangle_colours(representation, patch))
    on_surface = shown.add("", place.to_local(fine.values), fine)
    on_surface.matrix_world = holder.matrix_world
    on_surface.show_in_front = True
    _lay_out(shown, coarse, fine, context)
    return list(collection.objects)


def clear_inspection(context: Context) -> None:
    """Remove everything that the inspection shows."""
    remove_marked(INSPECTED)
    collection = bpy.data.collections.get(COLLECTION)
    if collection is not None and not collection.objects and not collection.children and collection.library is None:
        bpy.data.collections.remove(collection)
    noted = context.scene.sparse_surface.inspection
    noted.holder = ""
    noted.terms.clear()
    noted.energy.clear()


def _collection(context: Context) -> Collection:
    collection = bpy.data.collections.get(COLLECTION) or bpy.data.collections.new(COLLECTION)
    if collection.name not in context.scene.collection.children:
        context.scene.collection.children.link(collection)
    return collection


class _Shown:
    """Makes the objects of one patch."""

    def __init__(self, holder: Object, patch: int, collection: Collection, colours: Any) -> None:
        self.holder, self.patch, self.collection, self.colours = holder, patch, collection, colours

    def add(self, what: str, positions: Any, sheet: PatchSheet) -> Object:
        """Make an object of positions (P, 3) of a sheet; every triangle has the colour of its place on the result."""
        import numpy as np

        from .data import meshes as mesh_data

        name = f"Patch {self.patch} {what}".strip()
        mesh = mesh_data.create_mesh(name, positions, sheet.triangles.ravel(), np.full(len(sheet.triangles), 3))
        layer = mesh.attributes.new(PATCH_COLOUR, "FLOAT_COLOR", "CORNER")
        layer.data.foreach_set("color", np.repeat(self.colours[sheet.source], 3, axis=0).ravel())
        mesh.color_attributes.active_color_index = mesh.color_attributes.find(PATCH_COLOUR)
        made = bpy.data.objects.new(name, mesh)
        made[INSPECTED] = self.holder.name
        self.collection.objects.link(made)
        return made


def _triangle_colours(representation: Representation, patch: int) -> Any:
    """Colour of each of the patch's triangles by the direction that it faces, RGBA (t, 4): creases show as edges."""
    import numpy as np

    rows = slice(*representation.triangle_offsets[patch : patch + 2])
    a, b, c = (
        representation.vertices[representation.triangles[representation.mesh_triangles[rows], k]] for k in range(3)
    )
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    return np.concatenate([0.5 + 0.45 * normal, np.ones((len(normal), 1))], axis=1).astype(np.float32)


def _lay_out(shown: _Shown, coarse: PatchSheet, fine: PatchSheet, context: Context) -> None:
    """Rows of initial domain, optimised domain and function; one row for each coordinate, where these differ."""
    import numpy as np

    several = len(coarse.domains) > 1
    everything = np.concatenate([*coarse.initial_domains, *coarse.domains])
    extent = float(np.ptp(everything, axis=0).max())
    origin, size = _beside(shown.holder, context)
    for d, axis in enumerate("xyz"):
        c = d if several else 0
        whose = f" {axis}" if several else ""
        row = []
        if several or d == 0:
            row.append((f"Initial Domain{whose}", _flat(coarse.initial_domains[c]), coarse))
            row.append((f"Optimised Domain{whose}", _flat(coarse.domains[c]), coarse))
        over_domain = np.concatenate([fine.domains[c], fine.heights[:, [d]]], axis=1)
        row.append((f"{axis}(u, v)", over_domain, fine))
        for column, (what, positions, sheet) in zip((0, 1, 2)[-len(row) :], row, strict=True):
            made = shown.add(what, positions, sheet)
            made.show_name = True
            made.show_wire = made.show_all_edges = sheet is coarse
            tile = Vector(((column + 0.5) * (TILE + GAP), (d + 0.5) * (TILE + GAP), 0.0)) * size
            scale = TILE * size / extent if extent > 0.0 else 1.0
            made.matrix_world = Matrix.Translation(origin + tile) @ Matrix.Scale(scale, 4)


def _flat(domain: Any) -> Any:
    import numpy as np

    return np.concatenate([domain, np.zeros((len(domain), 1))], axis=1)


def _beside(holder: Object, context: Context) -> tuple[Vector, float]:
    """Return the lower corner of the free space at the right of an object, and the object's size in the world."""
    context.view_layer.update()
    corners = [holder.matrix_world @ Vector(corner) for corner in holder.bound_box]
    low, high = (Vector(tuple(pick(corner[k] for corner in corners) for k in range(3))) for pick in (min, max))
    size = max(high - low) or 1.0
    return Vector((high.x + GAP * size, low.y, low.z)), size


def _note(context: Context, holder: Object, representation: Representation, patch: int) -> None:
    """Note what the panel shows of the patch."""
    from ..solver.surface.inspection import patch_energy, patch_terms

    noted = context.scene.sparse_surface.inspection
    noted.holder, noted.patch = holder.name, patch
    noted.patches = representation.patches
    noted.vertices = int(representation.vertex_offsets[patch + 1] - representation.vertex_offsets[patch])
    for term in patch_terms(representation, patch):
        line = noted.terms.add()
        line.name, line.amounts = term.name, term.amounts
    for value in patch_energy(representation, patch):
        noted.energy.add().value = value


CLASSES = (SPARSE_SURFACE_OT_inspect_patch, SPARSE_SURFACE_OT_clear_inspection)

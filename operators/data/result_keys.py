"""What makes an object a result: its name and the properties that it carries.  Needs no NumPy: the panel asks here."""

from __future__ import annotations

from math import isfinite
from typing import Any

import bpy
from bpy.types import ID, Mesh, Object

REPORT = "sparse_surface"
"""Custom property of a result object: the report."""

SCALE = "error_color_range"
"""Custom property of an object with a heat map: lower and upper end of its range and its tolerance (0: none)."""

SHARES = "error_color_shares"
"""Custom property of an object with a heat map: which share of its area has values in each part of its range, from the
lowest to the highest; with a tolerance, in each of its bands."""

REPRESENTATION = "sparse_surface_representation"
"""Custom property of a result object: its representation, as the bytes of a saved file."""

DRAFT = "sparse_surface_draft"
"""Custom property of a result object whose representation is not yet compact."""

SHARED = "sparse_surface_shared"
"""Custom property of a result that is part of a surface: a mesh without faces that holds the whole's representation.

All parts refer to that mesh, so the functions are kept once, and as long as one of them."""

PART = "sparse_surface_part"
"""Custom property of such a result: how many of the surface's faces and of its vertices without faces come before."""

STRETCH = "sparse_surface_stretch"
"""Custom property of a result object whose source was scaled: nine numbers that lead from local to world lengths."""

SPLITS = "sparse_surface_splits"
"""Custom property of a reconstructed surface, whose mesh is finer than the representation's: number of parts of every
edge, and its numbers of vertices and faces."""

WITH_MODIFIERS = "sparse_surface_with_modifiers"
"""Custom property of a result object: whether its source was read as modifiers and shape keys left it."""

MADE_FROM = "sparse_surface_made_from"
"""Custom property of the objects of a reconstruction: the name of the points' object."""

SHIFT = "sparse_surface_shift"
"""Custom property of points and their surface: what was subtracted from the coordinates of the file, (3,)."""

EARLY = "sparse_surface_early"
"""Custom property of a result object while its surface is being solved: the session number of its source."""

PATCH_COLOUR = "patch_color"
"""Colour attribute of a result's mesh that shows its patches."""

ERROR, ERROR_COLOUR, PATCH, DOMAIN_STRETCH = "error", "error_color", "patch", "domain_stretch"
"""Attributes of a result's mesh."""

NOISY_POSITION = "noisy_position"
"""Attribute of a denoised result: where each vertex was before, in local coordinates."""

WEIGHT = "weight"
"""Attribute of reconstructed points: the weight of each in the fit."""

PARTNER = "partner"
"""Attribute of a measured object: the nearest point of the other surface, in the object's own coordinates."""

GAP = "gap"
"""Attribute of a separate patch: largest distance to another patch's point for the same vertex, in scene units."""

INSPECTED = "sparse_surface_inspected"
"""Custom property of what Inspect Patch lays out: the result's name.  A pointer would keep a deleted result alive."""

INSPECTION = "Sparse Surface Inspection"
"""Collection of what Inspect Patch lays out."""

DISTANCES = "sparse_surface_distance"
"""Custom property of an object whose distances from another were measured: the report as JSON."""

NAME_BYTES = 63
"""Blender cuts the names of data-blocks here."""


def result_name(source_name: str) -> str:
    """Return the name of a result object."""
    return cut_name(source_name, " Sparse Surface")


def cut_name(name: str, ending: str) -> str:
    """Return a name with an ending; the name is cut where both together are too long."""
    return name.encode()[: NAME_BYTES - len(ending.encode())].decode(errors="ignore") + ending


def read_report(candidate: Object | None) -> dict[str, Any] | None:
    """Return the report that a result object carries."""
    stored: Any = candidate.get(REPORT) if candidate is not None else None
    report: dict[str, Any] | None = stored.to_dict() if hasattr(stored, "to_dict") else None
    return report


def stored_numbers(holder: Object, name: str, count: int) -> list[float] | None:
    """Return the finite numbers of a custom property; None where there are others, or not as many.

    Whoever makes a .blend can put anything into a property.
    """
    try:
        numbers = [float(number) for number in holder.get(name, ())]
    except (TypeError, ValueError):
        return None
    return numbers if len(numbers) == count and all(map(isfinite, numbers)) else None


def has_representation(candidate: Object | None) -> bool:
    """Whether an object carries a representation."""
    return candidate is not None and candidate.type == "MESH" and REPRESENTATION in candidate


def shared_surface(candidate: Object | None) -> Mesh | None:
    """Return what holds the representation of the surface that an object is a part of."""
    found = candidate.get(SHARED) if candidate is not None and candidate.type == "MESH" else None
    return found if isinstance(found, Mesh) and REPRESENTATION in found else None


def has_functions(candidate: Object | None) -> bool:
    """Whether an object carries a representation, or is part of a surface of which one is kept."""
    return has_representation(candidate) or shared_surface(candidate) is not None


def has_heat_map(candidate: Object | None) -> bool:
    """Whether an object carries errors and their colours."""
    return candidate is not None and SCALE in candidate and _has_layer(candidate, ERROR, "FLOAT")


def has_patches(candidate: Object | None) -> bool:
    """Whether an object's mesh says which patch counts most at each vertex."""
    return candidate is not None and _has_layer(candidate, PATCH, "INT")


def shows_patches(shown: Object) -> bool:
    """Whether the colours of the patches are the active ones."""
    active = shown.data.color_attributes.active_color
    return active is not None and active.name == PATCH_COLOUR


def _has_layer(candidate: Object, name: str, kind: str) -> bool:
    layer = candidate.data.attributes.get(name) if candidate.type == "MESH" else None
    return layer is not None and (layer.data_type, layer.domain) == (kind, "POINT")


def store_representation(holder: ID, stored: bytes, *, draft: bool = True) -> None:
    """Keep a saved representation with an object; a draft is made compact later (`representation.compacting`).

    Blender carries a custom property of an object through saving, undo, duplicating and appending, and copies it only
    when it evaluates the object; it would copy a property of the mesh whenever a vertex moves.
    """
    for name in (REPRESENTATION, DRAFT):
        holder.pop(name, None)  # bytes assigned to an existing property end at their first zero
    holder[REPRESENTATION] = stored
    if draft:
        holder[DRAFT] = True


def forget_representation(holder: Object) -> None:
    """Have an object hold no representation, and nothing that says how to read one."""
    shared = holder.get(SHARED)
    for name in (REPRESENTATION, DRAFT, STRETCH, SHARED, PART):
        holder.pop(name, None)
    if isinstance(shared, Mesh) and shared.users == 0:
        bpy.data.meshes.remove(shared)

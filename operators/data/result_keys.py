"""What makes an object a result: its name and the properties it carries.  Needs no NumPy: the panel asks here."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.types import Object

REPORT = "sparse_surface"
"""Custom property of a result object: the report."""

SCALE = "error_color_range"
"""Custom property of an object with a heat map: lower and upper end of its range and its tolerance (0: none)."""

REPRESENTATION = "sparse_surface_representation"
"""Custom property of a result object: its representation, as the bytes of a saved file."""

STRETCH = "sparse_surface_stretch"
"""Custom property of a result object whose source was scaled: nine numbers that lead from local to world lengths."""

SPLITS = "sparse_surface_splits"
"""Custom property of a reconstructed surface, whose mesh is finer than the representation's: into how many parts every
edge was split, and the numbers of vertices and faces that this gave."""

MADE_FROM = "sparse_surface_made_from"
"""Custom property of the objects of a reconstruction: the name of the points' object."""

PATCH_COLOUR = "patch_color"
"""Colour attribute of a result's mesh that shows its patches."""

ERROR, ERROR_COLOUR, PATCH, DOMAIN_STRETCH = "error", "error_color", "patch", "domain_stretch"
"""Attributes of a result's mesh."""

WEIGHT = "weight"
"""Attribute of reconstructed points: how much each counted."""

NAME_BYTES = 63
"""Blender cuts the names of data-blocks here."""


def result_name(source_name: str) -> str:
    """Return the name of a result object."""
    return cut_name(source_name, " Sparse Surface")


def cut_name(name: str, ending: str) -> str:
    """Return a name with an ending; where both are too long the name gives way."""
    return name.encode()[: NAME_BYTES - len(ending.encode())].decode(errors="ignore") + ending


def read_report(candidate: Object | None) -> dict[str, Any] | None:
    """Return the report that a result object carries."""
    stored: Any = candidate.get(REPORT) if candidate is not None else None
    report: dict[str, Any] | None = stored.to_dict() if hasattr(stored, "to_dict") else None
    return report


def has_representation(candidate: Object | None) -> bool:
    """Whether an object carries a representation."""
    return candidate is not None and candidate.type == "MESH" and REPRESENTATION in candidate


def has_heat_map(candidate: Object | None) -> bool:
    """Whether an object carries errors and their colours."""
    if candidate is None or candidate.type != "MESH":
        return False
    layer = candidate.data.attributes.get(ERROR)
    return layer is not None and (layer.data_type, layer.domain) == ("FLOAT", "POINT") and SCALE in candidate


def marked_objects(mark: str) -> list[Object]:
    """Return the objects of this file that have a custom property."""
    return [candidate for candidate in bpy.data.objects if mark in candidate and candidate.library is None]


def remove_marked(mark: str) -> None:
    """Remove the objects with a custom property, and their meshes where nothing else has them."""
    marked = marked_objects(mark)
    meshes = {candidate.data for candidate in marked if candidate.type == "MESH"}
    for candidate in marked:
        bpy.data.objects.remove(candidate)
    for mesh in meshes:
        if mesh.users == 0:
            bpy.data.meshes.remove(mesh)

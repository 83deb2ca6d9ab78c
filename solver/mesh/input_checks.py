"""Refusing vertices and faces that cannot be worked on, in one sentence each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, Indices, extent_of, folded, has_masked, offsets_of, rows_at
from ..errors import InputError
from .normals import triangle_areas

NOT_THREE = "The vertices must be an array of three numbers each."

LARGEST_COORDINATE = 1e60
"""Squared areas still have to be finite."""


def as_positions(vertices: ArrayLike) -> NDArray[Any]:
    """Return the vertices as an array of the type that they have.

    Raises
    ------
    InputError
        When their rows differ in length.
    """
    try:
        return np.asanyarray(vertices)
    except ValueError:
        raise InputError(NOT_THREE) from None


def checked_vertices(vertices: ArrayLike) -> Array:
    if has_masked(vertices):
        raise InputError("The vertices are an array with masked values; fill them or leave them out first.")
    try:
        points = np.array(vertices, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(NOT_THREE) from None
    if points.size == 0:
        raise InputError("The mesh is empty: it has no vertices.")
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"The vertices must be an array of three numbers each, not of shape {points.shape}.")
    wrong = ~folded(np.logical_and, np.isfinite(points))
    if wrong.any():
        raise InputError(f"Vertex {int(np.argmax(wrong))} has a coordinate that is not a finite number.")
    if np.abs(points).max() > LARGEST_COORDINATE:
        raise InputError(f"The coordinates are too large to be computed with (beyond {LARGEST_COORDINATE:g}).")
    return points


def checked_faces(faces: ArrayLike | Sequence[Sequence[int]], vertex_count: int) -> tuple[Indices, Indices]:
    """Return the faces as one row of corners and offsets into it."""
    if has_masked(faces):
        raise InputError("The faces are an array with masked values; leave them out first.")
    if isinstance(faces, np.ndarray) and faces.dtype != object:
        array = _checked_indices(faces, "faces")
        if array.ndim != 2 and array.size:
            raise InputError(f"The faces must be a list of polygons, not an array of shape {array.shape}.")
        sizes = np.full(len(array), array.shape[1] if array.ndim == 2 else 0, dtype=np.int64)
        corners = array.reshape(-1)
    else:
        try:
            polygons = [list(polygon) for polygon in cast(Iterable[Iterable[int]], faces)]
            joined = np.array(list(chain.from_iterable(polygons)))
        except (TypeError, ValueError):
            raise InputError("The faces must be a list of polygons, each a list of vertex numbers.") from None
        sizes = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
        corners = _checked_indices(joined, "faces")
    if len(sizes) == 0:
        raise InputError("The mesh has no faces.")
    if sizes.min() < 3:
        raise InputError(f"Face {int(np.argmin(sizes))} has fewer than three corners.")
    _refuse_out_of_range(corners, vertex_count)
    return corners, offsets_of(sizes)


def checked_triangulation(
    triangles: tuple[ArrayLike, ArrayLike], vertex_count: int, face_count: int
) -> tuple[Indices, Indices]:
    try:
        triples, polygon = (_checked_indices(np.asarray(part), "triangles") for part in triangles)
    except ValueError as error:
        raise error if isinstance(error, InputError) else InputError("The triangles must be two arrays.") from None
    if triples.ndim != 2 or triples.shape[1:] != (3,) or polygon.shape != triples.shape[:1]:
        raise InputError("The triangles must be an array of three vertices each, and the face of each of them.")
    if len(triples) == 0:
        raise InputError("The mesh has no faces.")
    _refuse_out_of_range(triples, vertex_count)
    if polygon.min() < 0 or polygon.max() >= face_count:
        raise InputError(f"A triangle names a face that does not exist (there are {face_count}).")
    return triples, polygon


def _checked_indices(array: NDArray[np.generic], name: str) -> Indices:
    if array.size and not np.issubdtype(array.dtype, np.integer):
        raise InputError(f"The {name} must consist of whole numbers.")
    return array.astype(np.int64)


def _refuse_out_of_range(corners: Indices, vertex_count: int) -> None:
    low, high = int(corners.min()), int(corners.max())
    if low < 0 or high >= vertex_count:
        wrong = low if low < 0 else high
        raise InputError(f"A face names vertex {wrong}, but the vertices are numbered from 0 to {vertex_count - 1}.")


def refuse_without_area(points: Array, triangles: Indices) -> None:
    used = rows_at(points, triangles.reshape(-1))
    side = float(extent_of(used).max()) if len(used) else 0.0
    if side < 1 / LARGEST_COORDINATE or triangle_areas((points - used[0]) / side, triangles).sum() <= 1e-15:
        raise InputError("The mesh has no area: all of its faces are collapsed to lines or points.")


def checked_edges(edges: ArrayLike | None, vertices: int) -> Indices:
    """Return edges as pairs of vertices, (n, 2); none where None.

    Raises
    ------
    InputError
        When they are not pairs of the mesh's vertices.
    """
    if edges is None:
        return np.zeros((0, 2), dtype=np.int64)
    checked = np.asarray(edges)
    pairs = checked.reshape(0, 2) if not checked.size else checked
    whole = pairs.ndim == 2 and pairs.shape[1] == 2 and (pairs.dtype.kind in "iu" or not pairs.size)
    if not whole or pairs.min(initial=0) < 0 or pairs.max(initial=-1) >= vertices:
        raise InputError(f"Sharp edges must be pairs of vertex numbers from 0 to {vertices - 1}.")
    return pairs.astype(np.int64)

"""The representation that a result object holds, and where it stands on the object's mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Mesh, Object
from numpy.typing import NDArray

from ...solver.approximation.parts import Part
from ...solver.errors import InputError
from ...solver.surface.representation import Representation
from ..data.meshes import read_polygons, read_positions
from ..data.result_keys import PART, REPRESENTATION, SPLITS, STRETCH, shared_surface, stored_numbers

NEAR = 3e-5
"""Distance, as a share of the longest side, within which a vertex is where a compact representation puts it."""


def read_representation(holder: Object) -> Representation:
    """Return the representation that an object holds, or that of the surface which it is part of.

    Raises
    ------
    InputError
        When it holds none.
    FileFormatError
        When the stored bytes are damaged.
    """
    shared = shared_surface(holder)
    stored = (shared or holder).get(REPRESENTATION)
    if not isinstance(stored, bytes):
        raise InputError(
            rpt_("'{}' holds no representation; approximate its source again to get one.").format(holder.name)
        )
    return _parsed(stored, holder.name)


@lru_cache(maxsize=2)
def _parsed(stored: bytes, name: str) -> Representation:
    """Parse the bytes once while the user steps from patch to patch."""
    return Representation.from_bytes(stored, rpt_("The representation of '{}'").format(name))


@dataclass(frozen=True)
class Placement:
    """Where a representation stands in an object's local space: local = points @ linear + offset.

    Attributes
    ----------
    vertex
        Vertex of the representation that each of the mesh's vertices is; several where they are held together.
    """

    linear: NDArray[np.float64]
    offset: NDArray[np.float64]
    vertex: NDArray[np.int64]

    def to_local(self, points: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
        """Return local positions of the representation's points, (N, 3)."""
        local = np.asarray(points, dtype=np.float64) @ self.linear + self.offset
        return np.ascontiguousarray(local, dtype=np.float32)


def placement(holder: Object, representation: Representation) -> Placement:
    """Find where the representation stands on the object's mesh.

    The placement follows when all vertices are moved, scaled or turned together, as Apply Scale does.

    Raises
    ------
    InputError
        When the mesh was edited otherwise, so that the representation is no longer its own.
    """
    edited = _edited(holder)
    if SPLITS in holder:
        return _placement_of_finer(holder, representation, edited)
    vertex = _vertices_of(holder.data, representation)
    if vertex is None:
        raise edited
    local = read_positions(holder.data).astype(np.float64)
    return _found(holder, representation.at_vertices(), local, vertex, edited)


def place_of_part(holder: Object, representation: Representation) -> Part:
    """Find which faces and vertices of a surface those of an object are that is part of it.

    Raises
    ------
    InputError
        When the mesh was edited, so that its faces are others.
    """
    corners, sizes = read_polygons(holder.data)
    before, offsets = stored_numbers(holder, PART, 2), representation.face_offsets
    first, skipped = (int(number) for number in before or (-1, -1))
    last = first + len(sizes)
    if min(first, skipped) < 0 or last >= len(offsets) or not np.array_equal(np.diff(offsets[first : last + 1]), sizes):
        raise _edited(holder)
    inside = slice(int(offsets[first]), int(offsets[last]))
    vertex = np.full(len(holder.data.vertices), -1, dtype=np.int64)
    vertex[corners] = representation.face_corners[inside]
    free = np.flatnonzero(vertex < 0)
    own = np.setdiff1d(np.arange(len(representation.vertices)), representation.face_corners)[skipped:][: len(free)]
    if len(own) != len(free) or not np.array_equal(vertex[corners], representation.face_corners[inside]):
        raise _edited(holder)
    vertex[free] = own
    return Part(slice(first, last), inside, vertex)


def place_parts(holders: Sequence[Object], representation: Representation) -> list[tuple[Object, Part, Placement]]:
    """Find where a surface stands on the meshes of its parts: in one place for all, so that borders stay together.

    Parts that were edited are left out.  Where parts were transformed each by itself, each has its own place.

    Raises
    ------
    InputError
        When the last of them was edited.
    """
    found = []
    for holder in holders:
        try:
            part = place_of_part(holder, representation)
            found.append((holder, part, _placement_of([holder], [part], representation)))
        except InputError:
            if holder == holders[-1]:
                raise
    kept, parts = [each[0] for each in found], [each[1] for each in found]
    try:
        together = _placement_of(kept, parts, representation)
    except InputError:
        return found
    return [(holder, part, together) for holder, part in zip(kept, parts, strict=True)]


def _placement_of(holders: Sequence[Object], parts: Sequence[Part], representation: Representation) -> Placement:
    local = np.concatenate([read_positions(each.data).astype(np.float64) for each in holders])
    vertex = np.concatenate([part.place for part in parts])
    return _found(holders[-1], representation.at_vertices(), local, vertex, _edited(holders[-1]))


def _edited(holder: Object) -> InputError:
    return InputError(
        rpt_("The mesh of '{}' was edited; its representation describes another one.").format(holder.name)
    )


def _vertices_of(mesh: Mesh, representation: Representation) -> NDArray[np.int64] | None:
    """Return which vertex of the representation each vertex of the mesh is, (V,); None where the faces differ.

    Vertices without faces are the same ones in the same order.
    """
    corners, sizes = read_polygons(mesh)
    count = len(representation.vertices)
    if not np.array_equal(np.cumsum(sizes), representation.face_offsets[1:]):
        return None
    vertex = np.full(len(mesh.vertices), -1, dtype=np.int64)
    vertex[corners] = representation.face_corners
    own = np.setdiff1d(np.arange(count), representation.face_corners)
    free = np.flatnonzero(vertex < 0)
    if len(own) != len(free) or not np.array_equal(vertex[corners], representation.face_corners):
        return None
    vertex[free] = own
    return vertex


def _placement_of_finer(holder: Object, representation: Representation, edited: InputError) -> Placement:
    """Find the place on a mesh that is finer than the representation's: its first vertices are the same."""
    numbers, points = stored_numbers(holder, SPLITS, 3), representation.at_vertices()
    if numbers is None or numbers[1:] != [len(holder.data.vertices), len(holder.data.polygons)]:
        raise edited
    if len(holder.data.vertices) < len(points):
        raise edited
    local = read_positions(holder.data)[: len(points)].astype(np.float64)
    return _found(holder, points, local, np.arange(len(points)), edited)


def _found(
    holder: Object,
    at_vertices: NDArray[np.float64],
    local: NDArray[np.float64],
    vertex: NDArray[np.int64],
    edited: InputError,
) -> Placement:
    points = at_vertices[vertex]
    size = float(np.ptp(local, axis=0).max(initial=0.0))
    for linear, offset in (_as_stored(holder), _fitted(points, local)):
        place = Placement(linear, offset, vertex)
        if np.abs(place.to_local(points) - local).max(initial=0.0) <= NEAR * size:
            return place
    raise edited


def _as_stored(holder: Object) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    stretch = stored_numbers(holder, STRETCH, 9)
    linear: NDArray[np.float64] = np.eye(3)
    if stretch is not None:
        linear = np.linalg.pinv(np.array(stretch).reshape(3, 3)).astype(np.float64)
    return linear, np.zeros(3)


def _fitted(points: NDArray[np.float64], local: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Affine map that takes the points to the local positions, by least squares."""
    centre = points.mean(axis=0)
    solution, _, rank, _ = np.linalg.lstsq(points - centre, local - local.mean(axis=0), rcond=1e-9)
    if rank < 3:  # a plane says nothing about the direction across it
        return np.zeros((3, 3)), np.full(3, np.inf)
    linear: NDArray[np.float64] = solution.astype(np.float64)
    return linear, local.mean(axis=0) - centre @ linear

"""Vertices and faces in the order of a walk over the mesh: then a file of the surface need not spend bytes on order.

Vertex after vertex, the faces around it follow each other like a fan, and new vertices are numbered as they come.  So a
face begins at the vertex of the one before, continues where that one ended, and ends one number on; nearly always.
Meshes of triangles are walked over as `walk` does.
"""

from __future__ import annotations

import contextlib
from dataclasses import replace
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from ...arrays import Indices, offsets_of
from .capping import Capped
from .walk import NotWalkedError, Walking

Surface = TypeVar("Surface", bound=Any)


def in_walking_order(surface: Surface) -> Surface:
    """Return the same surface over the same mesh, vertices, faces and triangles renumbered as a walk meets them.

    Faces may begin at another of their corners.  Patches, functions and domains stay as they are.
    """
    if np.array_equal(surface.face_corners, surface.triangles.ravel()):
        with contextlib.suppress(NotWalkedError):
            return _in_order_of_triangles(surface)
    walk = _Walk(surface.face_offsets, surface.face_corners, len(surface.vertices))
    faces, number = np.array(walk.faces, dtype=np.int64), np.array(walk.number, dtype=np.int64)
    corners = [number[walk.turned(face)] for face in faces]
    place = np.empty_like(faces)
    place[faces] = np.arange(len(faces))
    rows = np.argsort(place[surface.polygon], kind="stable")
    triangles, polygon = number[surface.triangles[rows]], place[surface.polygon[rows]]
    for row, face in enumerate(polygon):
        if len(corners[face]) == 3:
            triangles[row] = corners[face]
    back = np.empty_like(rows)
    back[rows] = np.arange(len(rows))
    return replace(
        surface,
        vertices=surface.vertices[np.argsort(number)],
        triangles=triangles,
        polygon=polygon,
        face_offsets=offsets_of(np.array([len(each) for each in corners], dtype=np.int64)),
        face_corners=np.concatenate([*corners, np.zeros(0, dtype=np.int64)]),
        patch_vertices=number[surface.patch_vertices],
        mesh_triangles=back[surface.mesh_triangles],
        creases=number[surface.creases],
    )


def _in_order_of_triangles(surface: Surface) -> Surface:
    """Renumber as the walk does by which triangles are stored."""
    mesh = Capped.of(surface.triangles)
    walking = Walking(mesh.triangles, mesh.opposite)
    corners = np.array(walking.corners, dtype=np.int64).reshape(-1, 3)
    corners = corners[corners[:, 0] < surface.triangles.size]
    met = np.array(walking.met, dtype=np.int64)
    names = mesh.vertices[met[met < mesh.caps]]
    vertices, first = np.unique(names, return_index=True)
    order = np.concatenate([vertices[np.argsort(first)], np.setdiff1d(np.arange(len(surface.vertices)), vertices)])
    number, place = np.empty_like(order), np.empty(len(corners), dtype=np.int64)
    number[order], place[corners[:, 0] // 3] = np.arange(len(order)), np.arange(len(corners))
    triangles = number[surface.triangles.ravel()[corners]]
    return replace(
        surface,
        vertices=surface.vertices[order],
        triangles=triangles,
        face_corners=triangles.ravel().copy(),
        patch_vertices=number[surface.patch_vertices],
        mesh_triangles=place[surface.mesh_triangles],
        creases=number[surface.creases],
    )


class _Walk:
    """A walk over all faces: `faces` in its order, the `number` of each vertex, and where each face begins."""

    def __init__(self, offsets: Indices, corners: Indices, vertices: int) -> None:
        self._given = [corners[start:end].tolist() for start, end in pairwise(offsets.tolist())]
        # the faces in which a vertex is followed by another
        self._after: dict[tuple[int, int], list[int]] = {}
        self._around: list[list[int]] = [[] for _ in range(vertices)]
        for face, cycle in enumerate(self._given):
            for k, vertex in enumerate(cycle):
                self._after.setdefault((vertex, cycle[(k + 1) % len(cycle)]), []).append(face)
                self._around[vertex].append(face)
        self.faces: list[int] = []
        self.number = [-1] * vertices
        self._begin = [-1] * len(self._given)
        self._met: list[int] = []
        self._walk()

    def turned(self, face: int) -> list[int]:
        """Return a face's corners from where the walk came to it."""
        cycle = self._given[face]
        at = cycle.index(self._begin[face])
        return cycle[at:] + cycle[:at]

    def _walk(self) -> None:
        done = 0
        for start in range(len(self.number)):
            if self._around[start]:
                self._meet(start)
            while done < len(self._met):
                self._fan(self._met[done])
                done += 1
        for vertex in range(len(self.number)):
            self._meet(vertex)

    def _meet(self, vertex: int) -> None:
        if self.number[vertex] < 0:
            self.number[vertex] = len(self._met)
            self._met.append(vertex)

    def _fan(self, vertex: int) -> None:
        """Take the faces around a vertex that are left, each where the one before has ended."""
        left = [face for face in self._around[vertex] if self._begin[face] < 0]
        if not left:
            return
        ways = {self._sides(face, vertex)[0]: face for face in left}
        ends = {self._sides(face, vertex)[1] for face in left}
        # A fan begins at a side where none of the others ends; where it is closed, anywhere.
        for first in [*(side for side in ways if side not in ends), *ways]:
            side = first
            while (face := self._next(vertex, side)) >= 0:
                self._begin[face] = vertex
                self.faces.append(face)
                for corner in self.turned(face):
                    self._meet(corner)
                side = self._sides(face, vertex)[1]

    def _sides(self, face: int, vertex: int) -> tuple[int, int]:
        cycle = self._given[face]
        at = cycle.index(vertex)
        return cycle[(at + 1) % len(cycle)], cycle[at - 1]

    def _next(self, vertex: int, side: int) -> int:
        return next((face for face in self._after.get((vertex, side), ()) if self._begin[face] < 0), -1)

"""Faces and triangles as small differences."""

from __future__ import annotations

import numpy as np

from ...arrays import Indices, offsets_of
from ..container import demand
from .blocks import BlockReader, BlockWriter

FIRST, FAN = "first", "fan"


def write_triangles(blocks: BlockWriter, triangles: Indices) -> None:
    """Add triangles as steps between corners: c0 from the last c0, c1 from the last c2, c2 from c1."""
    last = np.vstack([np.zeros((1, 3), dtype=np.int64), triangles[:-1]])
    blocks.whole("triangles_0", triangles[:, 0] - last[:, 0])
    blocks.whole("triangles_1", triangles[:, 1] - last[:, 2])
    blocks.whole("triangles_2", triangles[:, 2] - triangles[:, 1])


def read_triangles(blocks: BlockReader, count: int, vertices: int) -> Indices:
    """Return what `write_triangles` added."""
    first, second, third = (blocks.whole(f"triangles_{k}", count) for k in range(3))
    c2 = np.cumsum(second + third)
    triangles = np.stack([np.cumsum(first), c2 - third, c2], axis=1)
    demand_range(triangles, vertices, "a triangle names a vertex that is not there")
    return triangles


def write_faces(blocks: BlockWriter, offsets: Indices, corners: Indices, triangles: Indices, polygon: Indices) -> None:
    """Add faces, and the triangles as corners of theirs."""
    blocks.whole("face_sizes", np.diff(offsets, prepend=0)[1:])
    blocks.whole("face_corners", np.diff(corners, prepend=0))
    blocks.whole("polygons", np.diff(polygon, prepend=0))
    place = np.zeros(triangles.shape, dtype=np.int64)
    sizes = np.diff(offsets)
    open_ = np.ones(triangles.shape, dtype=bool)
    for k in range(int(sizes.max(initial=0))):
        rows = np.flatnonzero(open_.any(axis=1) & (sizes[polygon] > k))
        if not len(rows):
            break
        here = open_[rows] & (triangles[rows] == corners[offsets[polygon[rows]] + k][:, None])
        place[rows] = np.where(here, k, place[rows])
        open_[rows] &= ~here
    blocks.whole("triangle_places", place)


def read_faces(
    blocks: BlockReader, faces: int, corners: int, triangles: int, vertices: int
) -> tuple[Indices, Indices, Indices, Indices]:
    """Return offsets and corners of the faces, triangles, and their faces."""
    sizes, names = blocks.whole("face_sizes", faces), np.cumsum(blocks.whole("face_corners", corners))
    demand_range(sizes, corners + 1, "a face has too many corners")
    offsets = offsets_of(sizes)
    demand(offsets[-1] == corners, "its faces do not have the corners that it says")
    demand_range(names, vertices, "a face names a vertex that is not there")
    polygon = np.cumsum(blocks.whole("polygons", triangles))
    demand_range(polygon, faces, "a triangle lies in a face that is not there")
    place = blocks.whole("triangle_places", triangles, 3)
    demand((place >= 0).all() and (place < sizes[polygon][:, None]).all(), "a triangle leaves its face")
    return offsets, names, names[offsets[polygon][:, None] + place], polygon


def demand_range(numbers: Indices, end: int, otherwise: str) -> None:
    """Refuse numbers that are not from 0 to below `end`."""
    demand(numbers.min(initial=0) >= 0 and numbers.max(initial=-1) < end, otherwise)

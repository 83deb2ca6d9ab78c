"""Faces and triangles: as a walk over the mesh, and where each triangle and vertex stands in it; or as differences."""

from __future__ import annotations

import numpy as np

from ...arrays import Indices, offsets_of
from ..container import demand
from .blocks import BlockReader, BlockWriter
from .capping import Capped
from .walk import NotWalkedError, Walk, Walking

FIRST, FAN = "first", "fan"


def write_triangles(blocks: BlockWriter, triangles: Indices, plain: bool) -> None:
    """Add triangles: as steps between corners, or as a walk where that is smaller and they need not be `plain`."""
    steps, walk = BlockWriter(), BlockWriter()
    _write_steps(steps, triangles)
    if not plain and _write_walk(walk, triangles) and walk.size < steps.size:
        blocks.take(walk)
    else:
        blocks.take(steps)


def _write_walk(blocks: BlockWriter, triangles: Indices) -> bool:
    """Add triangles as a walk over them, if one leads to them again."""
    try:
        mesh = Capped.of(triangles)
        walking = Walking(mesh.triangles, mesh.opposite)
    except NotWalkedError:
        return False
    met, walk = np.array(walking.met, dtype=np.int64), walking.walk()
    begins = np.array(walking.corners[::3], dtype=np.int64)
    number = np.empty_like(met)
    number[met] = np.arange(len(met))
    if not np.array_equal(walk.triangles(len(mesh.triangles)).ravel(), number[mesh.triangles.ravel()[walking.corners]]):
        return False
    begins = begins[begins < triangles.size]
    names = mesh.vertices[met[met < mesh.caps]]
    blocks.whole("valences", walk.valences)
    blocks.whole("forks", np.diff(walk.forks, prepend=0))
    blocks.whole("gaps", walk.gaps)
    blocks.whole("chords", walk.targets)
    blocks.whole("caps", np.diff(np.flatnonzero(met >= mesh.caps), prepend=0))
    blocks.whole("names", np.diff(names, prepend=0))
    blocks.whole("places", np.diff(begins // 3, prepend=0))
    blocks.whole("begins", begins % 3)
    return True


def _read_walk(blocks: BlockReader, count: int, vertices: int) -> Indices:
    # a cap has a triangle for each side of a border at most
    closed = 4 * count
    forks = blocks.listed("forks", closed, 3 * closed)
    walk = Walk(
        blocks.some("valences", 3 * closed), forks, blocks.some("gaps", 4 * closed), blocks.some("chords", closed)
    )
    triangles = walk.triangles(closed)
    capped = np.zeros(len(walk.valences), dtype=bool)
    capped[blocks.listed("caps", len(capped), len(capped))] = True
    triangles = triangles[~capped[triangles].any(axis=1)]
    demand(len(triangles) == count, "a walk does not have the triangles that it says")
    names = np.zeros(len(capped), dtype=np.int64)
    names[~capped] = np.cumsum(blocks.whole("names", int((~capped).sum())))
    demand_range(names, vertices, "a triangle names a vertex that is not there")
    places, begins = np.cumsum(blocks.whole("places", count)), blocks.whole("begins", count)
    demand_range(places, count, "a triangle has no place")
    demand_range(begins, 3, "a triangle begins nowhere")
    demand((np.bincount(places, minlength=count) == 1).all(), "two triangles have one place")
    found = np.empty((count, 3), dtype=np.int64)
    turned = (np.arange(3) + begins[:, None]) % 3
    found[places[:, None], turned] = names[triangles]
    return found


def _write_steps(blocks: BlockWriter, triangles: Indices) -> None:
    """Add triangles as steps between corners: c0 from the last c0, c1 from the last c2, c2 from c1."""
    last = np.vstack([np.zeros((1, 3), dtype=np.int64), triangles[:-1]])
    blocks.whole("triangles_0", triangles[:, 0] - last[:, 0])
    blocks.whole("triangles_1", triangles[:, 1] - last[:, 2])
    blocks.whole("triangles_2", triangles[:, 2] - triangles[:, 1])


def read_triangles(blocks: BlockReader, count: int, vertices: int) -> Indices:
    """Return what `write_triangles` added."""
    if "valences" in blocks:
        return _read_walk(blocks, count, vertices)
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

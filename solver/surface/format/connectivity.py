"""Faces and triangles: as a walk over the mesh, and where each triangle and vertex stands in it; or as differences."""

from __future__ import annotations

import numpy as np

from ...arrays import Booleans, Indices, offsets_of
from ..container import demand
from .blocks import BlockReader, BlockWriter
from .capping import Capped, opposite_sides
from .listing import REACH, Listing, listing_of_faces, listing_of_vertices
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
    _write_order(blocks, number[mesh.triangles.ravel()[walking.corners]].reshape(-1, 3), begins, met < mesh.caps, names)
    return True


def _write_order(blocks: BlockWriter, walked: Indices, begins: Indices, is_mesh: Booleans, names: Indices) -> None:
    """Add where the walk's triangles and vertices stand in the mesh, in the form that is smallest for each.

    `walked` are the walk's triangles, (F, 3); `begins` the mesh's corners at which those of the mesh begin; `is_mesh`
    tells which vertices are none of caps, and `names` has the mesh's vertex for each of them.
    """
    walked = walked[is_mesh[walked].all(axis=1)]
    sides = opposite_sides(walked)
    places, plain = np.empty_like(begins), BlockWriter()
    places[begins // 3] = 3 * np.arange(len(begins)) + -begins % 3
    plain.whole("places", np.diff(begins // 3, prepend=0))
    plain.whole("begins", begins % 3)
    listed = _written(listing_of_faces(sides, places, REACH), "face")
    blocks.take(min(plain, listed, key=lambda each: each.size))
    items, first = _in_first_use(walked, places, len(is_mesh))
    of = np.zeros(len(is_mesh), dtype=np.int64)
    of[is_mesh] = names
    own = of[walked.ravel()[first]]
    order, plain = np.argsort(own, kind="stable"), BlockWriter()
    plain.whole("names", np.diff(names, prepend=0))
    choices = [plain]
    for reach in (0, REACH):
        choices.append(_written(listing_of_vertices(sides, items, first, order, reach), "vertex"))
        choices[-1].whole("vertex_names", np.diff(own[order], prepend=0))
    blocks.take(min(choices, key=lambda each: each.size))


def _written(listing: Listing, name: str) -> BlockWriter:
    blocks = BlockWriter()
    listing.write(blocks, name)
    return blocks


def _in_first_use(walked: Indices, places: Indices, count: int) -> tuple[Indices, Indices]:
    """Number the vertices in the order in which the mesh's triangles first use them.

    Parameters
    ----------
    walked, count
        The walk's triangles, (T, 3), of vertices below `count`.
    places
        The corner of them at which each of the mesh's triangles begins, (T,).

    Returns
    -------
    The number at each corner, (3 T,), and the corner at which each number is first met.
    """
    corners = (places - places % 3)[:, None] + (places[:, None] + np.arange(3)) % 3
    met = walked.ravel()[corners.ravel()]
    first = np.full(count, -1)
    first[met[::-1]] = np.arange(len(met))[::-1]
    used = np.flatnonzero(first >= 0)
    used = used[np.argsort(first[used])]
    number = np.zeros(count, dtype=np.int64)
    number[used] = np.arange(len(used))
    return number[walked.ravel()], corners.ravel()[first[used]]


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
    return _read_order(blocks, triangles, capped, vertices)


def _read_order(blocks: BlockReader, walked: Indices, capped: Booleans, vertices: int) -> Indices:
    """Return the mesh's triangles, for those of the walk, (T, 3), and which of its vertices are caps' centres."""
    count, listed = len(walked), "face_moves" in blocks or "vertex_moves" in blocks
    sides = opposite_sides(walked) if listed else np.zeros(0, dtype=np.int64)
    if "face_moves" in blocks:
        each = 3 * np.arange(count)
        begins = Listing.read(blocks, "face", count).places(sides, np.repeat(each // 3, 3), each)
    else:
        places, turns = np.cumsum(blocks.whole("places", count)), blocks.whole("begins", count)
        demand_range(places, count, "a triangle has no place")
        demand_range(turns, 3, "a triangle begins nowhere")
        demand((np.bincount(places, minlength=count) == 1).all(), "two triangles have one place")
        begins = np.empty(count, dtype=np.int64)
        begins[places] = 3 * np.arange(count) + -turns % 3
    names = np.zeros(len(capped), dtype=np.int64)
    own = int((~capped).sum())
    if "vertex_moves" in blocks:
        items, first = _in_first_use(walked, begins, len(capped))
        demand(len(first) == own, "a vertex has no triangle")
        order = Listing.read(blocks, "vertex", own).places(sides, items, first)
        names[walked.ravel()[order]] = np.cumsum(blocks.whole("vertex_names", own))
    else:
        names[~capped] = np.cumsum(blocks.whole("names", own))
    demand_range(names, vertices, "a triangle names a vertex that is not there")
    corners = (begins - begins % 3)[:, None] + (begins[:, None] + np.arange(3)) % 3
    return names[walked.ravel()[corners]]


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

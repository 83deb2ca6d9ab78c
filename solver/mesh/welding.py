"""Vertices that lie at one place along open borders: which of them belong together.

Files hold a vertex several times where its UVs, normals or colours differ, where two parts were exported one by one, or
where a format knows triangles only.  Such borders are seams, not gaps.  Two open sides are joined where their ends
coincide and their triangles continue each other; so two sheets that lie on top of each other stay two sheets.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # loads `spatial` on first use
from numpy.typing import NDArray

from ..arrays import Array, Booleans, Indices, any_of, extent_of, length_of
from ..errors import InputError
from .edges import connected_parts, edge_keys, stable_order
from .pieces import Pieces
from .topology import pair_straightest

COINCIDENT = 1e-6
"""Share of the longest side of a connected piece within which two vertices are taken to be at one place."""

SHARE_OF_A_SIDE = 0.01
"""And the share of a triangle's side, the median of all.  One vertex far away makes a mesh large, not its details."""

ROUNDINGS = 2.0
"""By how many steps of its number type two copies of a coordinate may differ."""

ROUNDS = 8
"""How often pieces that come apart are measured again."""

MOST_NEIGHBOURS = 64
"""A distance within which a border vertex has more others than this, on average, does not tell copies apart."""


CELL_MARGIN = 0.01
"""By what share the cells in which copies are looked for are larger than they need be: more than rounding takes."""

DIRECTION = np.array([1.0, 0.618034, 0.324718]) / 1.219553
"""Along it the points of few meshes lie at one place: its coordinates have no simple ratios."""

MOST_STEPS = 16
"""How many points on, in their order along `DIRECTION`, one is looked for that may be near."""

LARGEST_KEY = 2.0**62
ROWS_AT_ONCE = 1 << 16


@dataclass(frozen=True, eq=False)
class Weld:
    """V vertices at P < V places.

    Attributes
    ----------
    place
        Place of each vertex, (V,).
    first
        First vertex at each place, (P,), ascending.
    """

    place: Indices
    first: Indices

    @property
    def merged(self) -> int:
        """Number of vertices that are held at the place of an earlier one."""
        return len(self.place) - len(self.first)

    def least(self, values: Array) -> Array:
        """Least of the values (V,) at each place, (P,)."""
        found = np.full(len(self.first), np.inf)
        np.minimum.at(found, self.place, values)
        return found


def automatic_distance(vertices: NDArray[np.generic], triangles: Indices) -> float:
    """Distance within which vertices (V, 3) of triangles (T, 3) are copies, or rounding where coarser.

    It is `COINCIDENT` of the longest side or `SHARE_OF_A_SIDE`, whichever is smaller.
    """
    points = vertices.astype(np.float64)
    step = float(np.finfo(vertices.dtype.char).eps) if vertices.dtype.kind == "f" else 0.0
    distance = COINCIDENT * float(extent_of(points).max())
    if len(triangles):
        sides = points[triangles] - points[np.roll(triangles, -1, axis=1)]
        distance = min(distance, SHARE_OF_A_SIDE * float(np.median(length_of(sides.reshape(-1, 3)))))
    return max(distance, ROUNDINGS * step * float(np.median(np.abs(points).max(axis=1))))


def close_distances(vertices: NDArray[np.generic], triangles: Indices, place: Indices) -> Array:
    """`automatic_distance` for each vertex, (V,), as if its piece of places (V,) were alone, but not more than for all.

    Numbers of single precision are rounded as such, whatever type they have.
    """
    points, most = vertices.astype(np.float64), automatic_distance(vertices, triangles)
    sides = place[np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)]
    count, piece = connected_parts(sides[:, 0], sides[:, 1], int(place.max(initial=-1)) + 1)
    pieces = Pieces.of(points, piece[place], count)
    long = length_of(points[triangles] - points[np.roll(triangles, -1, axis=1)]).reshape(-1)
    usual = pieces.medians(long, np.repeat(pieces.piece[triangles[:, 0]], 3))
    own = np.fmin(COINCIDENT * pieces.sizes, SHARE_OF_A_SIDE * usual)
    with np.errstate(over="ignore"):
        single = bool((points.astype(np.float32) == points).all())
    step = float(np.finfo(np.float32 if single else vertices.dtype.char).eps) if vertices.dtype.kind == "f" else 0.0
    rounding = ROUNDINGS * step * pieces.medians(np.abs(points).max(axis=1), pieces.piece)
    allowed: Array = np.minimum(np.maximum(own, rounding), most)[pieces.piece]
    return allowed


def find_copies(vertices: NDArray[np.generic], triangles: Indices, distance: float) -> Weld | None:
    """`find_weld` within a distance, scene units, or 0: within what the size of each connected piece says."""
    points = vertices.astype(np.float64)
    if distance:
        return find_weld(points, triangles, distance)
    allowed = np.full(len(points), automatic_distance(vertices, triangles))
    weld = find_weld(points, triangles, allowed)
    for _ in range(ROUNDS):
        if weld is None:
            return None
        before, allowed = allowed, np.minimum(allowed, close_distances(vertices, triangles, weld.place))
        if (length_of(points - points[weld.first][weld.place]) <= allowed).all() or (allowed == before).all():
            return weld
        weld = find_weld(points, triangles, allowed)
    return weld


def largest_distance(vertices: NDArray[Any]) -> float:
    """What `automatic_distance` does not exceed, whatever the triangles."""
    if not len(vertices):
        return 0.0
    low, high = vertices.min(axis=0).astype(np.float64), vertices.max(axis=0).astype(np.float64)
    step = float(np.finfo(vertices.dtype.char).eps) if vertices.dtype.kind == "f" else 0.0
    return max(COINCIDENT * float((high - low).max()), ROUNDINGS * step * float(np.abs([low, high]).max()))


def stand_apart(points: Array, distance: float) -> bool:
    """Whether certainly no two points (V, 3) are within a distance: then `find_weld` finds nothing.

    Only points that are near each other along a line can be near.  It takes a tenth of the time of finding open sides.
    """
    along = points @ DIRECTION
    order = np.argsort(along)
    along = along[order]
    largest = float(np.abs(points).max(initial=0.0))
    near = distance * (1.0 + CELL_MARGIN) + 32.0 * float(np.finfo(np.float64).eps) * largest
    first = np.arange(len(points))
    for step in range(1, MOST_STEPS + 1):
        first = first[: np.searchsorted(first, len(points) - step)]
        first = first[along[first + step] - along[first] <= near]
        if not len(first):
            return True
        if (length_of(points[order[first + step]] - points[order[first]]) <= near).any():
            return False
    return False


def may_coincide(vertices: NDArray[np.floating[Any]], distance: float) -> bool:
    """Whether some of the vertices (V, 3) may be copies; if not, none are, and `find_weld` need not be asked.

    Two vertices within a distance d are in one cell of a grid of cells 2 d long, or of one that is moved by d along
    some of the axes.  That takes 9 bytes a vertex, where finding the copies takes more than 500.

    Parameters
    ----------
    vertices
        Finite positions.
    distance
        Within which vertices are copies; 0: within `automatic_distance`, which the cells are certain to exceed.
    """
    low, high = vertices.min(axis=0).astype(np.float64), vertices.max(axis=0).astype(np.float64)
    step = float(np.finfo(vertices.dtype).eps)
    largest = float(np.abs([low, high]).max())
    reach = distance or max(COINCIDENT * float((high - low).max()), ROUNDINGS * step * largest)
    cell = 2.0 * reach * (1.0 + CELL_MARGIN)
    if cell == 0.0 or float(np.prod((high - low) / cell + 2.0)) > LARGEST_KEY:
        return True
    sides = ((high - low) / cell).astype(np.int64) + 2
    keys = np.empty(len(vertices), dtype=np.int64)
    for moved in np.ndindex(2, 2, 2):
        for start in range(0, len(keys), ROWS_AT_ONCE):
            part = vertices[start : start + ROWS_AT_ONCE].astype(np.float64)
            x, y, z = ((part - low) / cell + np.multiply(moved, 0.5)).astype(np.int64).T
            keys[start : start + ROWS_AT_ONCE] = (x * sides[1] + y) * sides[2] + z
        keys.sort()
        if (keys[1:] == keys[:-1]).any():
            return True
    return False


def find_weld(points: Array, triangles: Indices, distance: float | Array) -> Weld | None:
    """Find the vertices (V, 3) on open borders of triangles (T, 3) that belong together.

    The distance is one for all, or each vertex's own, (V,).  No triangle loses a corner by it.  None where every vertex
    stands alone.

    Raises
    ------
    InputError
        When the distance is so large that most of a border lies within it.
    """
    sides, start, end = _open_sides(triangles, len(points))
    if not len(sides):
        return None
    border, number = np.unique(np.concatenate([start, end]), return_inverse=True)
    group = _groups(points[border], np.broadcast_to(distance, len(points))[border])[number.reshape(2, -1)]
    pairs = _coincident_sides(points, triangles, sides, group)
    one, other = (np.stack([start[pair], end[pair]], axis=1) for pair in pairs.T)
    turned = group[0][pairs[:, 0]] != group[0][pairs[:, 1]]
    other[turned] = other[turned][:, ::-1]
    links = np.stack([one.reshape(-1), other.reshape(-1)], axis=1)
    label = _labels(links, len(points))
    lost = _lost(triangles, label)
    if lost.any():
        label = _labels(links[~np.isin(label[links[:, 0]], label[triangles[lost]])], len(points))
    first = np.unique(label, return_index=True)[1]
    return Weld(label, first) if len(first) < len(points) else None


def _open_sides(triangles: Indices, count: int) -> tuple[Indices, Indices, Indices]:
    """Sides `3 t + i` of triangles that share no vertices with another side, and their first and last vertex."""
    following = np.roll(triangles, -1, axis=1)
    sides = np.flatnonzero(np.repeat(~any_of(triangles == following), 3))
    start, end = triangles.reshape(-1)[sides], following.reshape(-1)[sides]
    key = edge_keys(start, end, count)
    order = stable_order(key)
    change = np.concatenate([[True], key[order][1:] != key[order][:-1], [True]]) if len(key) else np.zeros(1, bool)
    alone = np.sort(order[change[:-1] & change[1:]])
    return sides[alone], start[alone], end[alone]


def _groups(points: Array, distance: Array) -> Indices:
    """Group of each point, (n,): points within both distances of each other, and all that these lead to."""
    largest = float(distance.max())
    alike = float(distance.min()) == largest
    rows = points if alike else np.column_stack([points, distance])
    rows, place = np.unique(rows, axis=0, return_inverse=True)
    place, places = place.reshape(-1), rows[:, :3]
    if largest <= 0.0:
        return place
    tree = scipy.spatial.cKDTree(places)
    if tree.count_neighbors(tree, largest) > (1 + MOST_NEIGHBOURS) * len(places):
        raise InputError(f"The merge distance {largest:g} is larger than the details of the mesh.")
    near = tree.query_pairs(largest, output_type="ndarray")
    if not alike:
        allowed = rows[near, 3].min(axis=1)
        near = near[length_of(places[near[:, 0]] - places[near[:, 1]]) <= allowed]
    label: Indices = connected_parts(near[:, 0], near[:, 1], len(places))[1]
    return label[place]


def _coincident_sides(points: Array, triangles: Indices, sides: Indices, group: Indices) -> Indices:
    """Pairs (J, 2) of positions in `sides` whose ends have the same groups (2, S) and that continue each other."""
    apart = np.flatnonzero(group[0] != group[1])
    key = edge_keys(group[0][apart], group[1][apart], int(group.max()) + 1)
    order = stable_order(key)
    apart, key = apart[order], key[order]
    first = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]])) if len(key) else np.zeros(0, np.int64)
    count = np.diff(np.concatenate([first, [len(key)]]))
    many = count > 1
    forward = group[0][apart] < group[1][apart]
    paired = pair_straightest(points, triangles, sides[apart], first[many], count[many], forward)
    position = np.searchsorted(sides, paired)
    # A third sheet at a seam is held to it too; the mesh is cut there later.
    run = np.full(len(sides), -1)
    run[apart] = np.repeat(np.arange(len(first)), count)
    seam = np.full(len(first), -1)
    seam[run[position[:, 0]]] = position[:, 0]
    rest = np.setdiff1d(apart, position.reshape(-1))
    rest = rest[seam[run[rest]] >= 0]
    return np.concatenate([position, np.stack([seam[run[rest]], rest], axis=1)])


def _labels(links: Indices, count: int) -> Indices:
    label: Indices = connected_parts(links[:, 0], links[:, 1], count)[1]
    return label


def _lost(triangles: Indices, label: Indices) -> Booleans:
    """Triangles (T,) that would lose a corner."""
    merged = label[triangles]
    joined = (merged == np.roll(merged, -1, axis=1)) & (triangles != np.roll(triangles, -1, axis=1))
    lost: Booleans = any_of(joined)
    return lost

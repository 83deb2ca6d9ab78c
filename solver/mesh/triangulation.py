"""Triangulation of polygons: by rule for triangles, quads and convex polygons, by ear clipping for the others."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..arrays import Array, Booleans, Indices, offsets_of

_CLEARLY_WORSE = 0.25  # the first diagonal of a quad is left when its smaller triangle is this much smaller


def triangulate(points: Array, corners: Indices, offsets: Indices) -> tuple[Indices, Indices]:
    """Split polygons into triangles without new vertices.

    A corner that repeats the one before it is skipped; a polygon with fewer than three corners left has no triangle.

    Parameters
    ----------
    points
        Positions, (V, 3).
    corners, offsets
        Polygon `f` has the vertices `corners[offsets[f]:offsets[f + 1]]`.

    Returns
    -------
    Vertices of the triangles, (T, 3), in the winding of their polygons, and the polygon of each, (T,), ascending.
    """
    corners, offsets = _without_repeats(corners, offsets)
    sizes = np.diff(offsets)
    if (sizes == 3).all():
        return corners.reshape(-1, 3), np.arange(len(sizes))
    parts, owners = [], []
    for size in np.unique(sizes[sizes >= 3]):
        which = np.flatnonzero(sizes == size)
        rows = corners[offsets[which][:, None] + np.arange(size)]
        local = _split_equal(points[rows])
        parts.append(np.take_along_axis(rows, local.reshape(len(rows), -1), axis=1).reshape(-1, 3))
        owners.append(np.repeat(which, size - 2))
    if not parts:
        return np.zeros((0, 3), dtype=np.int64), np.zeros(0, dtype=np.int64)
    polygon = np.concatenate(owners)
    order = np.argsort(polygon, kind="stable")
    return np.concatenate(parts)[order], polygon[order]


def _without_repeats(corners: Indices, offsets: Indices) -> tuple[Indices, Indices]:
    previous = np.roll(corners, 1)
    previous[offsets[:-1]] = corners[offsets[1:] - 1]
    keep = corners != previous
    if keep.all():
        return corners, offsets
    return corners[keep], offsets_of(np.add.reduceat(keep.astype(np.int64), offsets[:-1]))


def _split_equal(polygons: Array) -> Indices:
    """Return the triangles, (F, n - 2, 3) local corners, of polygons with the same number of corners, (F, n, 3)."""
    size = polygons.shape[1]
    if size == 3:
        return np.broadcast_to(np.arange(3), (len(polygons), 1, 3)).copy()
    if size == 4:
        return _split_quads(polygons)
    balanced = np.array(_balanced_triangles(size), dtype=np.int64)
    result = np.repeat(balanced[None], len(polygons), axis=0)
    normals = newell_normals(polygons)
    areas = _signed_areas(polygons, balanced, normals)
    for index in np.flatnonzero(areas.min(axis=1) <= 1e-12 * np.abs(areas).max(axis=1)):
        result[index] = clip_ears(_in_plane(polygons[index], normals[index]))
    return result


def newell_normals(polygons: Array) -> Array:
    """Return the unnormalised area vectors (twice the area) of polygons (F, n, 3) by Newell's formula."""
    centred = polygons - polygons.mean(axis=1, keepdims=True)
    normal: Array = np.cross(centred, np.roll(centred, -1, axis=1)).sum(axis=1)
    return normal


def _signed_areas(polygons: Array, triangles: Indices, normals: Array) -> Array:
    a, b, c = (polygons[:, triangles[:, i]] for i in range(3))
    areas: Array = (np.cross(b - a, c - a) * normals[:, None]).sum(axis=2)
    return areas


def _split_quads(quads: Array) -> Indices:
    first = np.array([[0, 1, 2], [0, 2, 3]])
    second = np.array([[0, 1, 3], [1, 2, 3]])
    normals = newell_normals(quads)
    smaller = _signed_areas(quads, first, normals).min(axis=1)
    smaller_other = _signed_areas(quads, second, normals).min(axis=1)
    turn = (smaller < _CLEARLY_WORSE * smaller_other) | ((smaller <= 0) & (smaller_other > smaller))
    return np.where(turn[:, None, None], second, first)


@lru_cache(maxsize=256)
def _balanced_triangles(size: int) -> list[tuple[int, int, int]]:
    """Split a convex polygon by halving, so that no corner collects a long fan of needles."""
    triangles = []
    ranges = [(0, size - 1)]
    while ranges:
        low, high = ranges.pop()
        if high - low >= 2:
            middle = (low + high) // 2
            triangles.append((low, middle, high))
            ranges += [(low, middle), (middle, high)]
    return triangles


def _in_plane(polygon: Array, normal: Array) -> Array:
    """Project a polygon (n, 3) on the plane of its normal, (n, 2), counter-clockwise."""
    length = np.linalg.norm(normal)
    if length == 0.0:
        axes = np.linalg.svd(polygon - polygon.mean(axis=0), full_matrices=False)[2][:2]
    else:
        unit = normal / length
        helper = np.eye(3)[np.argmin(np.abs(unit))]
        first = np.cross(helper, unit)
        first /= np.linalg.norm(first)
        axes = np.stack((first, np.cross(unit, first)))
    flat: Array = (polygon - polygon.mean(axis=0)) @ axes.T
    return flat


def clip_ears(polygon: Array) -> Indices:
    """Triangulate one planar polygon by ear clipping.

    Corners at the same place (bridges to holes) are allowed.  Where no proper ear is left (the polygon crosses
    itself or is flat), the least bad corner is cut off, so that there are always n - 2 triangles.

    Parameters
    ----------
    polygon
        Corners, (n, 2), counter-clockwise.

    Returns
    -------
    Corner numbers of the triangles, (n - 2, 3).
    """
    corners = _Corners.of(polygon)
    triangles: list[tuple[int, int, int]] = []
    while len(triangles) < len(polygon) - 2:
        ears = corners.some_ears() or [corners.flattest()]
        triangles += [corners.cut(ear) for ear in ears[: len(polygon) - 2 - len(triangles)]]
    return np.array(triangles, dtype=np.int64)


@dataclass(eq=False)
class _Corners:
    """The corners of a polygon while ears are cut off it, all arrays (n, ...).

    `left` and `right` are the neighbours left over, `turn` is positive at convex corners, and `blocker` is a corner
    found inside of what would be an ear, or -1.
    """

    places: Array
    left: Indices
    right: Indices
    alive: Booleans
    turn: Array
    blocker: Indices

    @classmethod
    def of(cls, places: Array) -> _Corners:
        number = np.arange(len(places))
        left, right = np.roll(number, 1), np.roll(number, -1)
        turn = _turn(places[left], places, places[right])
        return cls(places, left, right, np.ones(len(places), dtype=bool), turn, np.full(len(places), -1))

    def some_ears(self) -> list[int]:
        """Return ears that can all be cut off because no two are neighbours.

        Cutting takes nothing but convex corners away, so an ear stays one while others are cut, and what is blocked by
        a reflex corner stays so until that corner is convex.
        """
        is_reflex = self.alive & (self.turn <= 0)
        candidates = np.flatnonzero(self.alive & (self.turn > 0) & ~((self.blocker >= 0) & is_reflex[self.blocker]))
        reflex = np.flatnonzero(is_reflex)
        reflex = reflex[np.argsort(self.places[reflex, 0], kind="stable")]
        untouched = self.alive.copy()
        ears: list[int] = []
        # Fattest corners first, and never all at once: fewer needles.
        for number, ear in enumerate(candidates[np.argsort(-self._shape(candidates), kind="stable")]):
            if ears and 2 * number >= len(candidates):
                break
            if untouched[ear]:
                self.blocker[ear] = self._find_blocker(ear, reflex)
                if self.blocker[ear] < 0:
                    ears.append(int(ear))
                    untouched[[self.left[ear], self.right[ear]]] = False
        return ears

    def flattest(self) -> int:
        """Return the corner that is nearest to a straight line."""
        remaining = np.flatnonzero(self.alive)
        return int(remaining[np.argmin(np.abs(self.turn[remaining]))])

    def cut(self, ear: int) -> tuple[int, int, int]:
        """Take a corner away and return its triangle."""
        before, after = int(self.left[ear]), int(self.right[ear])
        self.alive[ear] = False
        self.right[before], self.left[after] = after, before
        ends = np.array([before, after])
        self.turn[ends] = _turn(self.places[self.left[ends]], self.places[ends], self.places[self.right[ends]])
        self.blocker[ends] = -1
        return before, ear, after

    def _shape(self, ears: Indices) -> Array:
        a, b, c = self.places[self.left[ears]], self.places[ears], self.places[self.right[ears]]
        longest = np.max([((p - q) ** 2).sum(axis=-1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
        shape: Array = self.turn[ears] / np.maximum(longest, np.finfo(np.float64).tiny)
        return shape

    def _find_blocker(self, ear: int, reflex: Indices) -> int:
        """Return a reflex corner in the triangle or on its border, or -1; corners at its own places do not count.

        The reflex corners are sorted by x, so that only those between the triangle's ends need a look.
        """
        a, b, c = self.places[self.left[ear]], self.places[ear], self.places[self.right[ear]]
        x = self.places[reflex, 0]
        near = reflex[x.searchsorted(min(a[0], b[0], c[0])) : x.searchsorted(max(a[0], b[0], c[0]), side="right")]
        places = self.places[near]
        inside = (_turn(a, b, places) >= 0) & (_turn(b, c, places) >= 0) & (_turn(c, a, places) >= 0)
        inside &= ~((places == a).all(axis=1) | (places == b).all(axis=1) | (places == c).all(axis=1))
        return int(near[np.argmax(inside)]) if inside.any() else -1


def _turn(a: Array, b: Array, c: Array) -> Array:
    one, two = b - a, c - b
    turn: Array = one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0]
    return turn

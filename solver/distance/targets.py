"""What distances are measured to: the triangles of a mesh, or points.

A target is made of convex *elements*, triangles or points, which the bounds in `certified` rely on: the distance from
one element is a convex function of the place.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array, Indices
from ..mesh.normals import area_vectors, face_normals, unit
from ..native.library import reason_against
from ..native.nearest import Groups
from .groups import along_curve, group_sizes, members

POINTS_AT_ONCE = 1 << 15
PLACES_AT_ONCE = 1 << 10
FIRST_CANDIDATES, MOST_CANDIDATES = 10, 20
"""Centroids of triangles tried for all places, and for those where that does not suffice."""

THIN = 1e-8
"""Square of the sine of an angle: triangles with smaller ones are thin."""

LARGE = 1.2
"""A triangle is large whose radius exceeds this many median radii."""

MOST_PIECES = 3
"""Triangles are cut into pieces of similar size for the search: at most this many a triangle on average."""


class Nearest(NamedTuple):
    """The nearest points of a target for N places.

    Attributes
    ----------
    distance
        (N,), in scene units.
    element
        Triangle or point of the target, (N,).
    foot
        The nearest point itself, (N, 3).
    """

    distance: Array
    element: Indices
    foot: Array


class Target(ABC):
    """A surface or a cloud to which distances are measured."""

    corners: Array
    """Corners of each element, (E, 3, 3) or (E, 1, 3)."""

    def nearest(self, points: Array) -> Nearest:
        """Return the nearest points of the target for points (N, 3)."""
        found = [
            self._nearest_of_few(points[start : start + POINTS_AT_ONCE])
            for start in range(0, max(len(points), 1), POINTS_AT_ONCE)
        ]
        return Nearest(*(np.concatenate(parts) for parts in zip(*found, strict=True)))

    @abstractmethod
    def distance_to(self, points: Array, element: Indices) -> Array:
        """Return the distance of each point (N, 3) from one element (N,) of its own."""

    @abstractmethod
    def normals(self, found: Nearest) -> Array:
        """Return unit normals of the elements that were found, (N, 3)."""

    @abstractmethod
    def _nearest_of_few(self, points: Array) -> Nearest: ...


class PointTarget(Target):
    """A point cloud (P, 3), with the normals of the points where they are known, (P, 3)."""

    def __init__(self, points: Array, normals: Array | None = None) -> None:
        self.corners = points[:, None, :]
        self._points = points
        self._tree = cKDTree(points)
        self._normals = normals

    def distance_to(self, points: Array, element: Indices) -> Array:
        return np.asarray(np.linalg.norm(points - self._points[element], axis=1))

    def normals(self, found: Nearest) -> Array:
        """Normals by the plane through the twelve nearest points of each."""
        if self._normals is None:
            _, around = self._tree.query(self._points, k=min(12, len(self._points)))
            spread = self._points[around.reshape(len(self._points), -1)]
            spread = spread - spread.mean(axis=1, keepdims=True)
            self._normals = np.linalg.eigh(np.matmul(spread.swapaxes(1, 2), spread))[1][:, :, 0]
        return self._normals[found.element]

    def _nearest_of_few(self, points: Array) -> Nearest:
        distance, element = self._tree.query(points)
        return Nearest(distance, element.astype(np.int64), self._points[element])


class TriangleTarget(Target):
    """The triangles of a mesh: vertices (V, 3), triangles (T, 3); exact, however much the triangles differ in size.

    Notes
    -----
    The compiled kernel searches through boxes around groups of triangles.  What follows is for NumPy.

    Near the mesh, triangles are tried in the order of their centroids' distances.  No point of a triangle is farther
    from its centroid than the largest corner, so the search knows when no other triangle can be nearer.  One large
    triangle would make this bound useless for all; hence large triangles are cut into pieces for the search.

    Far from the mesh, too many centroids are almost equally near.  There the search descends through groups of
    triangles, each in a flat cylinder, whose distance bounds those of its triangles from below.
    """

    def __init__(self, vertices: Array, triangles: Indices, *, compiled: bool = True) -> None:
        """Prepare for the compiled kernel, or for NumPy where there is none or it is not wanted."""
        self.vertices, self.triangles = vertices, triangles
        self.corners = vertices[triangles]
        self._columns = np.ascontiguousarray(_planes(self.corners).T)
        self._normals = face_normals(vertices, triangles)
        self._order = along_curve(self.corners.mean(axis=1))
        self._groups = Groups(self.corners, self._order) if compiled and reason_against() is None else None
        if self._groups is not None:
            return
        pieces, self._owner = _cut_large(self.corners)
        centroids = pieces.mean(axis=1)
        self._radius = np.linalg.norm(pieces - centroids[:, None], axis=2).max(axis=1)
        self._largest = float(self._radius.max())
        self._tree = cKDTree(centroids)
        self._levels = _cylinders(self.corners[self._order])

    def distance_to(self, points: Array, element: Indices) -> Array:
        return np.asarray(np.linalg.norm(self._feet(points, element) - points, axis=1))

    def normals(self, found: Nearest) -> Array:
        return self._normals[found.element]

    def _feet(self, points: Array, element: Indices) -> Array:
        if self._groups is not None:
            return self._groups.feet(points, element)
        v, w, _ = _closest(points, self._columns, element)
        a, b, c = (self.corners[element, corner] for corner in range(3))
        feet: Array = a + v[:, None] * (b - a) + w[:, None] * (c - a)
        return feet

    def _nearest_of_few(self, points: Array) -> Nearest:
        if self._groups is not None:
            element, feet = self._groups.nearest(points)
            return Nearest(np.linalg.norm(feet - points, axis=1), element, feet)
        count = len(self._radius)
        best = np.full(len(points), np.inf)
        element = np.zeros(len(points), dtype=np.int64)
        pending, tried, wanted = np.arange(len(points)), 0, min(FIRST_CANDIDATES, count)
        while wanted > tried:
            apart, pieces = self._tree.query(points[pending], k=np.arange(tried + 1, wanted + 1))
            if tried == 0:  # the first candidate of all bounds what can be better
                self._try(points, pending, pieces[:, 0], best, element)
            least = apart - self._radius[pieces]
            for column in range(int(tried == 0), least.shape[1]):
                worth = least[:, column] < best[pending]
                self._try(points, pending[worth], pieces[worth, column], best, element)
            open_ = apart[:, -1] - self._largest < best[pending]
            pending = pending[open_] if wanted < count else pending[:0]
            self._descend(points, pending[best[pending] > self._largest], best, element)
            pending = pending[best[pending] <= self._largest]
            tried, wanted = wanted, min(MOST_CANDIDATES, count) if len(pending) else wanted
        self._descend(points, pending, best, element)
        feet = self._feet(points, element)
        return Nearest(np.linalg.norm(feet - points, axis=1), element, feet)

    def _try(self, points: Array, who: Indices, pieces: Indices, best: Array, element: Indices) -> None:
        owner = self._owner[pieces]
        distance = self._squared(points[who], owner) ** 0.5
        nearer = distance < best[who]
        best[who[nearer]], element[who[nearer]] = distance[nearer], owner[nearer]

    def _squared(self, points: Array, triangle: Indices) -> Array:
        return np.maximum(_closest(points, self._columns, triangle)[2], 0.0)

    def _descend(self, points: Array, pending: Indices, best: Array, element: Indices) -> None:
        """Find what is nearer than `best`, through groups of triangles."""
        for start in range(0, len(pending), PLACES_AT_ONCE):
            own = pending[start : start + PLACES_AT_ONCE]
            top = len(self._levels[-1])
            who, group = np.repeat(own, top), np.tile(np.arange(top), len(own))
            for depth in range(len(self._levels) - 1, -1, -1):
                worth = _least_distance(points[who], self._levels[depth][group]) < best[who]
                below = len(self._levels[depth - 1]) if depth else len(self._order)
                who, group = members(who[worth], group[worth], depth, below)
            triangle = self._order[group]
            distance = self._squared(points[who], triangle) ** 0.5
            first = np.lexsort((triangle, distance, who))
            who, distance, triangle = who[first], distance[first], triangle[first]
            lead = np.flatnonzero(np.diff(who, prepend=-1))
            lead = lead[distance[lead] < best[who[lead]]]
            best[who[lead]], element[who[lead]] = distance[lead], triangle[lead]


def _cylinders(corners: Array) -> list[Array]:
    """Return cylinders around groups of triangles (T, 3, 3), level by level, (G, 8): centre, axis, radius and height.

    The height is measured from the centre to both ends.
    """
    vectors = area_vectors(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    levels = []
    for size in group_sizes(len(corners)):
        starts = np.arange(0, len(corners), size)
        group = np.arange(len(corners)) // size
        low = np.minimum.reduceat(corners.min(axis=1), starts)
        centre = 0.5 * (low + np.maximum.reduceat(corners.max(axis=1), starts))
        axis = unit(np.add.reduceat(vectors, starts))
        offset = corners - centre[group][:, None]
        along = (offset * axis[group][:, None]).sum(axis=2)
        aside = np.linalg.norm(offset - along[:, :, None] * axis[group][:, None], axis=2)
        sizes = [np.maximum.reduceat(each.max(axis=1), starts) for each in (aside, np.abs(along))]
        levels.append(np.column_stack([centre, axis, *sizes]))
    return levels


def _least_distance(points: Array, cylinder: Array) -> Array:
    """Return the distance of each point (N, 3) from a cylinder (N, 8), a little less for rounding."""
    offset = points - cylinder[:, :3]
    along = (offset * cylinder[:, 3:6]).sum(axis=1)
    squared = (offset * offset).sum(axis=1)
    aside = np.sqrt(np.maximum(squared - along * along, 0.0)) - cylinder[:, 6]
    above = np.abs(along) - cylinder[:, 7]
    least = np.sqrt(np.maximum(aside, 0.0) ** 2 + np.maximum(above, 0.0) ** 2)
    return np.asarray(least - 1e-7 * np.sqrt(squared))


def _planes(corners: Array) -> Array:
    """Return what `_closest` needs of each triangle, (T, 12): a corner, two sides, and the sides' products."""
    a, one, two = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    products = [(one * one).sum(axis=1), (one * two).sum(axis=1), (two * two).sum(axis=1)]
    return np.column_stack([a, one, two, *products])


def _closest(points: Array, columns: Array, triangle: Indices) -> tuple[Array, Array, Array]:
    """Return the shares v, w of the two sides at the closest point of a triangle, and the squared distance, (N,) each.

    The squared distance is a quadratic function of (v, w).  Its minimum over the triangle is the free minimum, or lies
    on one of the sides v = 0, w = 0, v + w = 1.
    """
    ax, ay, az, ux, uy, uz, vx, vy, vz, uu, uv, vv = columns[:, triangle]
    px, py, pz = points[:, 0] - ax, points[:, 1] - ay, points[:, 2] - az
    pu, pv = px * ux + py * uy + pz * uz, px * vx + py * vy + pz * vz
    pp = px * px + py * py + pz * pz
    area = uu * vv - uv * uv
    thin = area <= THIN * uu * vv
    scale = 1.0 / np.where(area > 0.0, area, 1.0)
    v, w = (vv * pu - uv * pv) * scale, (uu * pv - uv * pu) * scale
    outside = (v < 0.0) | (w < 0.0) | (v + w > 1.0)
    # the free minimum of a thin triangle may be all rounding
    free = np.where(outside, np.inf, v * (v * uu - 2.0 * pu) + w * (w * vv - 2.0 * pv) + 2.0 * v * w * uv)
    outside = np.flatnonzero(outside | thin)
    if len(outside):
        pu_, pv_, uu_, uv_, vv_ = (each[outside] for each in (pu, pv, uu, uv, vv))
        along_u = np.clip(pu_ / np.where(uu_ > 0.0, uu_, 1.0), 0.0, 1.0)
        along_v = np.clip(pv_ / np.where(vv_ > 0.0, vv_, 1.0), 0.0, 1.0)
        third = uu_ - 2.0 * uv_ + vv_
        across = np.clip((uu_ - uv_ - pu_ + pv_) / np.where(third > 0.0, third, 1.0), 0.0, 1.0)
        on_u = along_u * (along_u * uu_ - 2.0 * pu_)
        on_v = along_v * (along_v * vv_ - 2.0 * pv_)
        rest = 1.0 - across
        on_third = rest * (rest * uu_ - 2.0 * pu_) + across * (across * vv_ - 2.0 * pv_) + 2.0 * rest * across * uv_
        use_v = (on_v < on_u) & (on_v <= on_third)
        use_third = (on_third < on_u) & ~use_v
        best = free[outside] <= np.minimum(np.minimum(on_u, on_v), on_third)
        v[outside] = np.where(best, v[outside], np.where(use_third, rest, np.where(use_v, 0.0, along_u)))
        w[outside] = np.where(best, w[outside], np.where(use_third, across, np.where(use_v, along_v, 0.0)))
    squared = pp + v * (v * uu - 2.0 * pu) + w * (w * vv - 2.0 * pv) + 2.0 * v * w * uv
    return v, w, squared


def _cut_large(corners: Array) -> tuple[Array, Indices]:
    """Halve triangles until none is much larger than most; return the pieces (P, 3, 3) and the triangle of each."""
    owner = np.arange(len(corners))
    radius = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    limit = LARGE * float(np.median(radius))
    while (np.ceil((radius / max(limit, 1e-300)) ** 2)).sum() > MOST_PIECES * len(corners) + 1000:
        limit *= 1.25
    small: list[tuple[Array, Indices]] = []
    while len(corners):
        radius = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2).max(axis=1)
        large = radius > limit
        small.append((corners[~large], owner[~large]))
        corners, owner = corners[large], np.repeat(owner[large], 2)
        longest = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).argmax(axis=1)
        order = (longest[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(corners, order[:, :, None], axis=1).swapaxes(0, 1)
        middle = 0.5 * (a + b)
        corners = np.stack([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)], axis=1)
        corners = corners.reshape(-1, 3, 3)
    return np.concatenate([part for part, _ in small]), np.concatenate([part for _, part in small])

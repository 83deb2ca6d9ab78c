"""The largest distance of a surface from a target, between two bounds.

The distance d(x) from a target changes by at most |x - y| between x and y, and the distance from any one of its convex
elements is a convex function of x, largest at a corner of a triangle.  So no point of a triangle with corners x_i is
farther than

    min( min_i (d(x_i) + max_k |x_i - x_k|), min_e max_i d(x_i, e) ),

with e the elements that are nearest to its corners (Y. Zheng et al., "Economic upper bound estimation in Hausdorff
distance computation for triangle meshes", 2022).  Triangles whose bound exceeds the largest distance found are split
in four until the two meet.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from .targets import Target

Values = TypeVar("Values", bound=NDArray[Any])

TRIANGLES_AT_ONCE = 2000
MOST_PLACES = 250_000


class Largest(NamedTuple):
    """The largest distance that was found, an upper bound for all others, where it is, (3,), and its partner, (3,)."""

    found: float
    bound: float
    place: Array
    partner: Array


def largest_distance(
    vertices: Array, triangles: Indices, distance: Array, element: Indices, target: Target, tolerance: float
) -> Largest:
    """Bound the largest distance of a mesh from a target.

    Parameters
    ----------
    vertices, triangles
        The mesh, (V, 3) and (T, 3).
    distance, element
        Of each vertex, (V,): its distance from the target and the target's nearest element.
    tolerance
        The bounds may stay this far apart; they stay farther apart where that takes too many places.
    """
    used = np.unique(triangles)
    first = used[distance[used].argmax()]
    found, place = float(distance[first]), vertices[first]
    corners, apart, near = vertices[triangles], distance[triangles], element[triangles]
    bound = _bounds(corners, apart, near, target)
    places = 0
    while True:
        open_ = bound > found + tolerance
        corners, apart, near, bound = corners[open_], apart[open_], near[open_], bound[open_]
        if not len(bound):
            highest = found + tolerance
            break
        if places > MOST_PLACES:
            highest = float(bound.max())
            break
        order = np.argsort(-bound, kind="stable")
        now, later = order[:TRIANGLES_AT_ONCE], order[TRIANGLES_AT_ONCE:]
        middles = 0.5 * (corners[now] + np.roll(corners[now], -1, axis=1))
        nearest = target.nearest(middles.reshape(-1, 3))
        places += nearest.distance.size
        best = int(nearest.distance.argmax())
        if nearest.distance[best] > found:
            found, place = float(nearest.distance[best]), middles.reshape(-1, 3)[best]
        quarter: tuple[Array, Array, Indices] = (
            _split(corners[now], middles),
            _split(apart[now], nearest.distance.reshape(-1, 3)),
            _split(near[now], nearest.element.reshape(-1, 3)),
        )
        fresh = np.minimum(_bounds(*quarter, target), np.repeat(bound[now], 4))
        corners = np.concatenate([corners[later], quarter[0]])
        apart = np.concatenate([apart[later], quarter[1]])
        near = np.concatenate([near[later], quarter[2]])
        bound = np.concatenate([bound[later], fresh])
    return Largest(found, highest, place, target.nearest(place[None]).foot[0])


def _split(corners: Values, middles: Values) -> Values:
    """Return the values at the corners of the four parts of each triangle, (4 n, 3, ...)."""
    a, b, c = (corners[:, k] for k in range(3))
    ab, bc, ca = (middles[:, k] for k in range(3))
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    stacked: Any = np.stack([np.stack(part, axis=1) for part in parts], axis=1)
    return stacked.reshape(-1, *stacked.shape[2:])


def _bounds(corners: Array, apart: Array, near: Indices, target: Target) -> Array:
    """Return how far from the target any point of each triangle can be, (n,)."""
    sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
    best = (apart + np.maximum(sides, np.roll(sides, 1, axis=1))).min(axis=1)
    same = (near == near[:, :1]).all(axis=1)
    best[same] = np.minimum(best[same], apart[same].max(axis=1))
    rest = np.flatnonzero(~same)
    for one in range(3):
        others = [
            target.distance_to(corners[rest, corner], near[rest, one]) for corner in ((one + 1) % 3, (one + 2) % 3)
        ]
        best[rest] = np.minimum(best[rest], np.maximum(apart[rest, one], np.maximum(*others)))
    return best

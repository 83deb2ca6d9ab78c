"""A clean look at a cloud before anything else: which points count, and where the origin is best put.

Real clouds hold rows that are not points, points that were written twice, and strays.  Doubles break each estimate that
is made from nearest neighbours, and strays become part of a base that is made of all points; so both are found first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from ..arrays import Array, Booleans, Indices
from ..errors import InputError
from ..mesh.edges import connected_parts
from .geometry import neighbours, typical_spacing
from .strays import stray_points
from .two_sides import outward_normals

Number = TypeVar("Number", np.float64, np.int64)

FEWEST_POINTS = 4

SAME_PLACE, NEARLY = 1e-6, 1e-3
"""Points closer than this share of the longest side, or of the spacing, are one point written twice.  Of evenly random
points three in a million are as close as the second."""

NEIGHBOURS = 9

FAR_AWAY = 64.0
"""Coordinates are shifted when they are this many times larger than the cloud is long: single precision would leave
steps of 4e-6 of its longest side."""


@dataclass(frozen=True)
class CleanCloud:
    """The points of a cloud that count.

    Attributes
    ----------
    rows
        All of the input, (R, 3).
    points
        (N, 3), distinct, finite, each near others, in the order of the rows.
    source
        Which of them each row of the input became, -1 where it is left out, (R,).
    strays, not_finite
        Which rows are left out and why, (R,).
    duplicates
        How many rows were merged into others.
    shift
        What had been subtracted from the coordinates before, (3,).
    outward
        What `outward_normals` makes of given normals, (N, 3), or None.
    """

    rows: Array
    points: Array
    source: Indices
    strays: Booleans
    not_finite: Booleans
    duplicates: int
    shift: Array
    outward: Array | None = None

    def averaged(self, values: Array) -> Array:
        """Average values of the rows, (R, k), over those that became one point, (N, k)."""
        kept = self.source >= 0
        sums = np.zeros((len(self.points), values.shape[1]))
        np.add.at(sums, self.source[kept], values[kept])
        count = np.bincount(self.source[kept], minlength=len(self.points))
        return sums / np.maximum(count, 1)[:, None]

    def of_rows(self, values: NDArray[Number], missing: NDArray[Number]) -> NDArray[Number]:
        """Give each row the value of the point that it became, and those left out what is in `missing`, (R, ...)."""
        kept = self.source >= 0
        result = missing.copy()
        result[kept] = values[self.source[kept]]
        return result

    def counts(self) -> dict[str, Any]:
        """What `Report.input` says of this."""
        return {
            "points": len(self.source),
            "used": len(self.points),
            "duplicates": self.duplicates,
            "strays": int(self.strays.sum()),
            "not_finite": int(self.not_finite.sum()),
            "shift": [float(value) for value in self.shift],
        }


def clean(
    points: ArrayLike, keep_strays: bool = False, shift: Array | None = None, normals: Array | None = None
) -> CleanCloud:
    """Look at a cloud's rows (R, 3): drop what is not finite, merge doubles, leave strays out.

    Parameters
    ----------
    points
        (R, 3), scene units.
    keep_strays
        Let strays count like other points.
    shift
        What was subtracted from the coordinates before; only noted.
    normals
        Given ones of the rows, (R, 3), of any length: they tell the sides of thin parts apart.

    Raises
    ------
    InputError
        When the rows are not three numbers each, or fewer than four points are left.
    """
    rows = _rows(points)
    finite = np.asarray(np.isfinite(rows).all(axis=1), dtype=np.bool_)
    refuse_few(int(finite.sum()), len(rows))
    places = rows[finite]
    if float(np.ptp(places, axis=0).max()) == 0.0:
        raise InputError("All the points are at one place.")
    merged, number = _merged(places)
    stray = np.zeros(len(merged), dtype=bool) if keep_strays else stray_points(merged)
    refuse_few(len(merged) - int(stray.sum()), len(rows))
    source, strays = np.full(len(rows), -1), np.zeros(len(rows), dtype=bool)
    source[finite] = np.where(stray, -1, np.cumsum(~stray) - 1)[number]
    strays[finite] = stray[number]
    moved = np.zeros(3) if shift is None else shift
    found = CleanCloud(rows, merged[~stray], source, strays, ~finite, len(number) - len(merged), moved)
    if normals is None or not np.isfinite(normals[source >= 0]).all():
        return found
    return replace(found, outward=outward_normals(found.points, found.averaged(normals)))


def far_origin(points: Array) -> Array:
    """Where the origin is best put for single precision: zeros for a cloud (R, 3) that lies near it, else whole units.

    Examples
    --------
    >>> import numpy as np
    >>> from sparse_surface.solver.reconstruction.cleaning import far_origin
    >>> far_origin(np.array([[500000.2, 5600000.0, 210.0], [500040.0, 5600031.0, 214.0]]))
    array([ 500020., 5600016.,     212.])
    """
    places = points[np.isfinite(points).all(axis=1)]
    if not len(places):
        return np.zeros(3)
    low, high = places.min(axis=0), places.max(axis=0)
    middle, size = 0.5 * (low + high), float((high - low).max())
    if float(np.abs(places).max()) <= FAR_AWAY * size:
        return np.zeros(3)
    origin: Array = np.round(middle) if size >= 1.0 else middle
    return origin


def _rows(points: ArrayLike) -> Array:
    try:
        array = np.array(points, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("The points must be an array of three numbers each.") from None
    if array.size and (array.ndim != 2 or array.shape[1] != 3):
        raise InputError(f"The points must be an array of three numbers each, not of shape {array.shape}.")
    return array.reshape(-1, 3)


def refuse_few(left: int, rows: int) -> None:
    """Refuse a cloud of which too few rows can be used.

    Raises
    ------
    InputError
        When fewer than four are left.
    """
    if left < FEWEST_POINTS:
        where = f"there are {rows}" if left == rows else f"of {rows} only {left} can be used"
        raise InputError(f"A surface needs at least {FEWEST_POINTS} points; {where}.")


def _merged(places: Array) -> tuple[Array, Indices]:
    """Average points that are the same or nearly so; returns the distinct ones and the number of each row's."""
    _, first, number = np.unique(places, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    distinct, number = places[first[order]], place[number.ravel()]
    tree = cKDTree(distinct)
    spacing = typical_spacing(neighbours(tree, min(NEIGHBOURS, len(distinct)))[0]) if len(distinct) > 1 else 0.0
    size = float(np.ptp(distinct, axis=0).max())
    pairs = tree.query_pairs(max(NEARLY * spacing, SAME_PLACE * size), output_type="ndarray")
    if not len(pairs):
        return distinct, number
    groups, group = connected_parts(pairs[:, 0], pairs[:, 1], len(distinct))
    members = np.bincount(group, minlength=groups)
    merged = distinct[np.unique(group, return_index=True)[1]]
    sums = np.stack([np.bincount(group, weights=column) for column in distinct.T], axis=1)
    several = members > 1
    merged[several] = sums[several] / members[several, None]
    return merged, group[number]

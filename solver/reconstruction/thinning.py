"""Clouds too large to be held: read in parts, and thinned to the means of the cells of a grid.

The grid is the finest that leaves no more points than asked for.  Which one that is shows while the points are read:
cells are made twice as long whenever there are too many, and what they hold is added up.  So the points that are left
do not depend on how the cloud is read nor, but for rounding, on its order.  At the end thin cells join neighbours.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Booleans, Indices
from ..errors import InputError
from ..progress import Progress, Steps
from ..settings import MOST_POINTS
from .batches import Batch, Parts, batches
from .cleaning import far_origin, refuse_few

BITS = 26
"""Cells of the finest grid along each axis are two to this power."""

GRIDS = 3
"""Grids whose cells differ by equal factors below two: the finest has about 0.6 of the cells asked for, or more."""

OFF_CENTRE = 0.1180339887
"""A grid exceeds the points by this share of their longest side: the middle of a symmetric cloud is then no border."""

SHARE_OF_NEW = 4
"""New cells wait until they are more than the points asked for, divided by this, and then take their places."""

THIN = 0.25
"""A cell with fewer rows than this share of a neighbour's becomes part of that one.  Where the surface passes near a
side of a cell, the cell behind holds only the edge of the noise, and its mean would count as much as any other."""

CHANGED = "The points changed while they were read."

Keys = NDArray[np.complex128]
"""Numbers of cells, in the order of x, y and z: the first two make the real part, which holds 53 bits."""


@dataclass(frozen=True)
class Extent:
    """What a first look at all rows shows.

    Attributes
    ----------
    rows, finite
        How many there are, and how many of them are finite.
    box
        Around these, (2, 3).
    coloured, directed
        Whether every row has a colour, and a normal.
    """

    rows: int
    finite: int
    box: Array
    coloured: bool
    directed: bool

    def values(self, batch: Batch) -> Array:
        """Return points of a batch with the colours and normals that every row has, (n, 3), (n, 6) or (n, 9).

        Raises
        ------
        InputError
            When they have gone.
        """
        wanted = [batch.points, *([batch.colours] * self.coloured), *([batch.normals] * self.directed)]
        columns = [own for own in wanted if own is not None]
        if len(columns) < len(wanted):
            raise InputError(CHANGED)
        return np.concatenate(columns, axis=1)


@dataclass(frozen=True)
class ThinCloud:
    """What is left of a cloud.

    Attributes
    ----------
    points
        Means of the rows in each cell, (K, 3), less `origin`; a thin cell is part of a neighbour.
    colours, normals
        Means of what the rows have, (K, 3), or None where a row has none.
    counts
        Rows that became each point, (K,).
    extent
        Of all rows.
    origin
        What was subtracted from the coordinates, (3,).
    grid
        Which cell a row is in.
    point_of_cell
        And which point that became, (C,).
    """

    points: Array
    colours: Array | None
    normals: Array | None
    counts: Indices
    extent: Extent
    origin: Array
    grid: Grid
    point_of_cell: Indices

    def find(self, points: Array) -> Indices:
        """Return which point each row at (n, 3) became, -1 where it is in a cell that no row was in."""
        cell = self.grid.find(points)
        return np.where(cell >= 0, self.point_of_cell[cell], -1)

    @property
    def merged(self) -> int:
        """How many rows became part of another's point."""
        return int(self.counts.sum()) - len(self.counts)


def thin_steps(parts: Parts, most: int = MOST_POINTS, *, shift: bool = False, expected: int = 0) -> Steps[ThinCloud]:
    """Thin a cloud, reading it twice.

    Parameters
    ----------
    parts
        The cloud; rows that are not finite are only counted.
    most
        Points that are left at most.
    shift
        Whether the origin moves to clouds that are far from it (see `far_origin`).
    expected
        About how many rows there are, for the progress.

    Raises
    ------
    InputError
        When fewer than four rows are finite, all are at one place, or the second reading finds others than the first.
    """
    extent = yield from _extent_steps(parts, expected)
    low, size = extent.box[0], float(np.ptp(extent.box, axis=0).max())
    if size == 0.0:
        raise InputError("All the points are at one place.")
    corner, side = low - OFF_CENTRE * size, (1.0 + 2.0 * OFF_CENTRE) * size
    columns = 3 * (1 + extent.coloured + extent.directed)
    grids = [Grid(corner, side * 2.0 ** (k / GRIDS), most, columns) for k in range(GRIDS)]
    rows = finite = 0
    for batch in batches(parts):
        yield Progress("Reading the points", 0.4 + 0.6 * rows / extent.rows)
        good = _finite(batch.points)
        rows, finite = rows + len(good), finite + int(good.sum())
        values = extent.values(batch)[good]
        values[:, :3] -= corner
        for grid in grids:
            grid.add(batch.points[good], values)
    for grid in grids:
        grid.settle()
    if (rows, finite) != (extent.rows, extent.finite):
        raise InputError(CHANGED)
    return _thinned(min(grids, key=lambda each: each.cell), extent, shift)


def _thinned(grid: Grid, extent: Extent, shift: bool) -> ThinCloud:
    origin, owner = far_origin(extent.box) if shift else np.zeros(3), grid.owners()
    kept, point_of_cell = np.unique(owner, return_inverse=True)
    means, counts = grid.means(point_of_cell, len(kept))
    points = means[:, :3] + (grid.corner - origin)
    colours = means[:, 3:6] if extent.coloured else None
    normals = means[:, -3:] if extent.directed else None
    return ThinCloud(points, colours, normals, counts, extent, origin, grid, point_of_cell.reshape(-1))


def _extent_steps(parts: Parts, expected: int) -> Steps[Extent]:
    rows, finite, coloured, directed = 0, 0, True, True
    box = np.array([[np.inf] * 3, [-np.inf] * 3])
    for batch in batches(parts):
        yield Progress("Reading the points", min(0.4, 0.4 * rows / max(expected, 1)))
        places = batch.points[_finite(batch.points)]
        rows, finite = rows + len(batch.points), finite + len(places)
        coloured, directed = coloured and batch.colours is not None, directed and batch.normals is not None
        if len(places):
            box = np.array([np.minimum(box[0], places.min(axis=0)), np.maximum(box[1], places.max(axis=0))])
    refuse_few(finite, rows)
    return Extent(rows, finite, box, coloured, directed)


def _finite(points: Array) -> Booleans:
    return np.asarray(np.isfinite(points).all(axis=1), dtype=np.bool_)


class Grid:
    """Sums over the cells of a grid, whose cells grow where they are more than `most`.

    Parameters
    ----------
    corner, side
        Of a cube that holds all points, (3,) and its length.
    most
        Cells that are held at most.
    columns
        What is summed of each row.
    """

    def __init__(self, corner: Array, side: float, most: int, columns: int) -> None:
        self.corner, self._most = corner, most
        self._finest, self._halved = side / 2.0**BITS, 0
        self._sums = _Sums(np.zeros(0, np.complex128), np.zeros(0, np.int64), np.zeros((0, columns)))
        self._new: list[_Sums] = []

    @property
    def cell(self) -> float:
        """Length of a cell's sides."""
        return float(self._finest * 2.0**self._halved)

    def owners(self) -> Indices:
        """Return for each cell (C,) the one whose part it becomes: itself unless it is thin."""
        counts = self._sums.counts
        fullest, most = np.arange(len(counts)), counts.copy()
        for step in itertools.product((-1.0, 0.0, 1.0), repeat=3):
            known, place = self._sums.place(_numbered(self._sums.cells + step))
            fuller = known & (counts[place] > most)
            fullest[fuller], most[fuller] = place[fuller], counts[place[fuller]]
        owner = np.where(counts < THIN * most, fullest, np.arange(len(counts)))
        while (owner[owner] != owner).any():  # the fullest neighbour may be thin beside another
            owner = owner[owner]
        return owner

    def means(self, group: Indices, count: int) -> tuple[Array, Indices]:
        """Return means of what was added in each of `count` groups of cells, (count, columns), and rows, (count,).

        Cells say their groups, (C,).
        """
        counts, sums = np.zeros(count, np.int64), np.zeros((count, self._sums.sums.shape[1]))
        np.add.at(counts, group, self._sums.counts)
        np.add.at(sums, group, self._sums.sums)
        return sums / counts[:, None], counts

    def add(self, points: Array, values: Array) -> None:
        """Add rows, their places (n, 3) and what is summed of them, (n, columns)."""
        added = _Sums(self._keys(points), np.ones(len(points), np.int64), values).added()
        known, place = self._sums.place(added.keys)
        self._sums.counts[place[known]] += added.counts[known]
        self._sums.sums[place[known]] += added.sums[known]
        self._new.append(added.some(~known))
        if sum(len(each.keys) for each in self._new) > self._most // SHARE_OF_NEW:
            self.settle()

    def settle(self) -> None:
        """Put new cells in their places, and let cells grow until they are few enough."""
        self._sums = _Sums.joined([self._sums, *self._new]).added()
        self._new = []
        while len(self._sums.keys) > self._most:
            self._halved += 1
            self._sums = self._sums.coarser().added()

    def find(self, points: Array) -> Indices:
        """Return which cell each point (n, 3) is in, -1 where it is one that no row was in."""
        known, place = self._sums.place(self._keys(points))
        return np.where(known, place, -1)

    def _keys(self, points: Array) -> Keys:
        cells = np.clip(np.floor((points - self.corner) / self._finest), 0.0, 2.0**BITS - 1.0)
        return _numbered(np.floor(cells / 2.0**self._halved))


@dataclass(frozen=True)
class _Sums:
    """Numbers of cells (n,), rows in them (n,) and what these add up to, (n, c)."""

    keys: Keys
    counts: Indices
    sums: Array

    def added(self) -> _Sums:
        """Add up what stands under the same number, in the order of the numbers."""
        if not len(self.keys):
            return self
        order = np.argsort(self.keys, kind="stable")
        keys = self.keys[order]
        first = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]]))
        sums = np.add.reduceat(self.sums[order], first, axis=0)
        return _Sums(keys[first], np.add.reduceat(self.counts[order], first), sums)

    def place(self, keys: Keys) -> tuple[Booleans, Indices]:
        """Which numbers are among these, which are in order, and where, (n,) each."""
        if not len(self.keys):
            return np.zeros(len(keys), dtype=bool), np.zeros(len(keys), dtype=np.int64)
        place = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        return self.keys[place] == keys, place

    def some(self, which: Booleans) -> _Sums:
        """Return some of them."""
        return _Sums(self.keys[which], self.counts[which], self.sums[which])

    def coarser(self) -> _Sums:
        """Give them the numbers of cells twice as long."""
        return _Sums(_numbered(np.floor(self.cells / 2.0)), self.counts, self.sums)

    @property
    def cells(self) -> Array:
        """The cells' places in the grid, (n, 3)."""
        x = np.floor(self.keys.real / 2.0**BITS)
        return np.stack([x, self.keys.real - x * 2.0**BITS, self.keys.imag], axis=1)

    @classmethod
    def joined(cls, several: list[_Sums]) -> _Sums:
        """Put them together as they are."""
        columns = zip(*((each.keys, each.counts, each.sums) for each in several), strict=True)
        return cls(*map(np.concatenate, columns))


def _numbered(cells: Array) -> Keys:
    numbers = np.empty(len(cells), np.complex128)
    numbers.real, numbers.imag = cells[:, 0] * 2.0**BITS + cells[:, 1], cells[:, 2]
    return numbers

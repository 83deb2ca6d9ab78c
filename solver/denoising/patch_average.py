"""Averages over overlapping patches: normals of triangles, and the planes on which each vertex should lie."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..arrays import Array, Booleans, Indices
from ..mesh.normals import unit
from .one_sided_patches import Fits

_BUFFER = 1 << 19  # entries that are summed up at once
_SYMMETRIC = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_WINDOW = 16  # times as many seeds as are wanted at once are looked through
_CERTAIN = 0.5  # weight from which a patch counts as covering a triangle


class _Sums:
    """Sums of numbers in rows, (columns, N), that belong to `count` places, in the order in which they come."""

    def __init__(self, count: int, columns: int) -> None:
        self._sums = np.zeros((count, columns))
        self._places: list[Indices] = []
        self._rows: list[Array] = []
        self._waiting = 0

    def add(self, places: Indices, rows: Array) -> None:
        self._places.append(places)
        self._rows.append(rows)
        self._waiting += len(places)
        if self._waiting > _BUFFER:
            self._flush()

    def total(self) -> Array:
        self._flush()
        return self._sums

    def so_far(self) -> Array:
        """Return the sums, but leave what waits waiting: the order of additions decides about the last bit."""
        sums = self._sums.copy()
        _add(sums, self._places, self._rows)
        return sums

    def fade(self, where: Booleans, share: float) -> None:
        self._flush()
        self._sums[where] *= share

    def include(self, other: _Sums) -> None:
        self._flush()
        self._sums += other.total()

    def _flush(self) -> None:
        _add(self._sums, self._places, self._rows)
        self._places, self._rows, self._waiting = [], [], 0


def _add(sums: Array, places: list[Indices], rows: list[Array]) -> None:
    if places:
        where = np.concatenate(places)
        for column, what in enumerate(np.concatenate(rows, axis=1)):
            sums[:, column] += np.bincount(where, what, len(sums))


class PatchAverage:
    """Averages over patches, each weighted with the inverse of its variance at the place.

    Parameters
    ----------
    triangle_count, vertex_count
        Size of the mesh.
    misfit_power
        How strongly a patch loses weight whose residuals are larger than the noise.

    Attributes
    ----------
    hurried
        Whether someone asked to finish: one patch over each triangle is enough then.
    """

    def __init__(self, triangle_count: int, vertex_count: int, misfit_power: float) -> None:
        self._misfit_power = misfit_power
        self._normals = _Sums(triangle_count, 4)
        self._planes = _Sums(vertex_count, 12)
        self._covers = np.zeros((triangle_count, 2), dtype=np.int64)  # patches over each triangle, and their sizes
        self.hurried = False

    @property
    def coverage(self) -> Indices:
        """How many patches cover each triangle by now, (T,)."""
        return self._covers[:, 0]

    @property
    def patch_sizes(self) -> Array:
        """Mean number of triangles of the patches that cover each triangle, (T,); 0 where none does."""
        count, sizes = self._covers.T
        mean: Array = sizes / np.maximum(count, 1)
        return mean

    def uncrowded(self, seeds: Indices, crowd: int, most: int) -> Iterator[tuple[float, Indices]]:
        """Yield at most so many of the seeds at a time: those over which no crowd of patches lies by then.

        With them comes the share of the seeds that were looked at before.
        """
        start = 0
        while start < len(seeds):
            window = seeds[start : start + _WINDOW * most]
            places = np.flatnonzero(self.coverage[window] < (1 if self.hurried else crowd))[:most]
            if len(places):
                yield start / len(seeds), window[places]
            start += int(places[-1]) + 1 if len(places) == most else len(window)

    def add(self, fits: Fits) -> None:
        """Add patches; those that are not sound are ignored."""
        fits = fits.select(np.flatnonzero(fits.sound))
        if not len(fits):
            return
        trust = np.maximum(fits.misfit, 1.0) ** -self._misfit_power
        at_triangle = fits.triangle_weights > 0
        weight = fits.triangle_weights * trust[:, None] / fits.spread(fits.at_triangle)
        leaning = fits.normals_of_triangles()[at_triangle]
        self._normals.add(fits.triangles[at_triangle], _rows(leaning, weight[at_triangle]))
        at_vertex = fits.vertex_weights > 0
        weight = (fits.vertex_weights * trust[:, None] / fits.spread(fits.at_vertex))[at_vertex]
        everywhere = fits.normals_at_vertices()
        # A residual is measured along the seed's normal; the way to the surface is shorter where that leans.
        upright = np.einsum("pnc,pc->pn", everywhere, fits.frames[:, :, 2])
        normals, offsets = everywhere[at_vertex], (-fits.residuals * upright)[at_vertex]
        rows = _rows_of_planes(normals.T, offsets, fits.responses[at_vertex], weight)
        self._planes.add(fits.vertices[at_vertex], rows)
        covers = fits.triangle_weights > _CERTAIN
        covered, sizes = fits.triangles[covers], covers.sum(axis=1)
        np.add.at(self._covers[:, 0], covered, 1)
        np.add.at(self._covers[:, 1], covered, np.repeat(sizes, sizes))

    def fade(self, triangles: Booleans, vertices: Booleans, share: float) -> None:
        """Let the patches so far weigh only that share over some triangles, (T,), and at some vertices, (V,)."""
        self._normals.fade(triangles, share)
        self._planes.fade(vertices, share)

    def include(self, other: PatchAverage) -> None:
        """Add all patches of another average over the same mesh."""
        self._normals.include(other._normals)
        self._planes.include(other._planes)
        self._covers += other._covers

    def normals(self, guide: Array) -> Array:
        """Return the triangles' averaged normals, (T, 3); the guide's where no patch has a value."""
        averaged = unit(self._normals.total()[:, :3])
        return np.where((averaged == 0).all(axis=1)[:, None], guide, averaged)

    def normal_variances(self) -> Array:
        """Return how much the patches differ about each triangle's normal, (T,): variances along one tangent.

        Where no patch has a value, as if every direction were as likely as any other.
        """
        sums = self._normals.total()
        agreeing = ((sums[:, :3] / np.where(sums[:, 3] > 0, sums[:, 3], 1.0)[:, None]) ** 2).sum(axis=1)
        variances: Array = np.maximum(1 - agreeing, 0.0) / 2
        return variances

    def stiffness(self, moves: Array, directions: Array, least: float) -> Array:
        """Return how firmly the patches hold each vertex, (V,), along its direction, (V, 3), after its move, (V, 3).

        One over the variance of the planes that they give for it, which is at least `least`; infinite without patches.
        """
        matrices, targets, weight = self.planes()
        squares = self._planes.total()[:, 10] / np.where(weight > 0, weight, 1.0)
        through = np.einsum("vi,vij,vj->v", moves, matrices, moves) - 2 * (targets * moves).sum(axis=1)
        along = np.einsum("vi,vij,vj->v", directions, matrices, directions)
        return np.where(weight > 0, along / np.maximum(squares + through, least), np.inf)

    def responses(self) -> Array:
        """Return the patches' mean height at each vertex, (V,), if the noise were `signs`; 0 without patches."""
        sums = self._planes.total()
        mean: Array = sums[:, 11] / np.where(sums[:, 9] > 0, sums[:, 9], 1.0)
        return mean

    def planes(self) -> tuple[Array, Array, Array]:
        """Return the mean equations of the vertices.

        Returns
        -------
        Mean of n n^T over the planes at each vertex, (V, 3, 3), of n d with d the distance to the plane along n,
        (V, 3), and the total weight, (V,), 0 where no patch has a value.
        """
        return _mean_equations(self._planes.total())

    def planes_so_far(self, *others: PatchAverage) -> tuple[Array, Array, Array]:
        """Return `planes` of these patches and those of `others`; what is added later comes out as without the look."""
        return _mean_equations(sum((other._planes.so_far() for other in others), self._planes.so_far()))


def _rows(normals: Array, weights: Array) -> Array:
    """Return weighted normals, (N, 3), and the weights, (4, N)."""
    rows = np.empty((4, len(weights)))
    np.multiply(normals.T, weights, out=rows[:3])
    rows[3] = weights
    return rows


def _rows_of_planes(normals: Array, offsets: Array, responses: Array, weights: Array) -> Array:
    """Return what is summed up of planes with normals n, (3, N), and distances d, weighted: (12, N).

    n n^T, n d, 1, d^2, and the responses.
    """
    rows = np.empty((12, len(weights)))
    for row, (i, j) in zip(rows[:6], _SYMMETRIC, strict=True):
        np.multiply(normals[i], normals[j], out=row)
    np.multiply(normals, offsets, out=rows[6:9])
    rows[9] = 1.0
    np.multiply(offsets, offsets, out=rows[10])
    rows[11] = responses
    rows *= weights
    return rows


def _mean_equations(sums: Array) -> tuple[Array, Array, Array]:
    """Return what `PatchAverage.planes` does from the sums at each vertex, (V, 12)."""
    weight = sums[:, 9]
    mean = sums[:, :9] / np.where(weight > 0, weight, 1.0)[:, None]
    matrices = np.empty((len(sums), 3, 3))
    for column, (i, j) in enumerate(_SYMMETRIC):
        matrices[:, i, j] = matrices[:, j, i] = mean[:, column]
    return matrices, mean[:, 6:9], weight

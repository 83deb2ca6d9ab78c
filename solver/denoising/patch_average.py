"""Averages over overlapping patches: normals of triangles, and the planes on which each vertex should lie."""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices
from ..mesh.normals import unit
from .one_sided_patches import Fits

_BUFFER = 1 << 19  # entries that are summed up at once
_SYMMETRIC = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_CERTAIN = 0.5  # weight from which a patch counts as covering a triangle


class _Sums:
    """Sums of rows of numbers that belong to `count` places, in the order in which they come."""

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

    def include(self, other: _Sums) -> None:
        self._flush()
        self._sums += other.total()

    def _flush(self) -> None:
        _add(self._sums, self._places, self._rows)
        self._places, self._rows, self._waiting = [], [], 0


def _add(sums: Array, places: list[Indices], rows: list[Array]) -> None:
    if places:
        where, what = np.concatenate(places), np.concatenate(rows)
        for column in range(what.shape[1]):
            sums[:, column] += np.bincount(where, what[:, column], len(sums))


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
        self._normals = _Sums(triangle_count, 3)
        self._planes = _Sums(vertex_count, 10)
        self._covers = _Sums(triangle_count, 2)  # patches over each triangle, and the sum of their sizes
        self.hurried = False

    @property
    def coverage(self) -> Array:
        """How many patches cover each triangle, (T,)."""
        return self._covers.total()[:, 0]

    @property
    def patch_sizes(self) -> Array:
        """Mean number of triangles of the patches that cover each triangle, (T,); 0 where none does."""
        count, sizes = self._covers.total().T
        return sizes / np.maximum(count, 1)

    def add(self, fits: Fits) -> None:
        """Add patches; those that are not sound are ignored."""
        fits = fits.select(fits.sound)
        if not len(fits):
            return
        trust = np.maximum(fits.misfit, 1.0) ** -self._misfit_power
        at_triangle = fits.triangle_weights > 0
        weight = fits.triangle_weights * trust[:, None] / fits.spread(fits.at_triangle)
        rows = fits.normals(fits.at_triangle) * weight[..., None]
        self._normals.add(fits.triangles[at_triangle], rows[at_triangle])
        at_vertex = fits.vertex_weights > 0
        weight = (fits.vertex_weights * trust[:, None] / fits.spread(fits.at_vertex))[at_vertex]
        everywhere = fits.normals(fits.at_vertex)
        # A residual is measured along the seed's normal; the way to the surface is shorter where that leans.
        upright = np.einsum("pnc,pc->pn", everywhere, fits.frames[:, :, 2])
        normals, offsets = everywhere[at_vertex], (-fits.residuals * upright)[at_vertex]
        products = np.stack([normals[:, i] * normals[:, j] for i, j in _SYMMETRIC], axis=1)
        targets = normals * offsets[:, None]
        rows = np.concatenate((products, targets, np.ones((len(normals), 1))), axis=1) * weight[:, None]
        self._planes.add(fits.vertices[at_vertex], rows)
        covers = fits.triangle_weights > _CERTAIN
        covered, sizes = fits.triangles[covers], covers.sum(axis=1)
        self._covers.add(covered, np.column_stack((np.ones(len(covered)), np.repeat(sizes, sizes))))

    def include(self, other: PatchAverage) -> None:
        """Add all patches of another average over the same mesh."""
        self._normals.include(other._normals)
        self._planes.include(other._planes)
        self._covers.include(other._covers)

    def normals(self, guide: Array) -> Array:
        """Return the triangles' averaged normals, (T, 3); the guide's where no patch has a value."""
        averaged = unit(self._normals.total())
        return np.where((averaged == 0).all(axis=1)[:, None], guide, averaged)

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


def _mean_equations(sums: Array) -> tuple[Array, Array, Array]:
    """Return what `PatchAverage.planes` does from the sums at each vertex, (V, 10)."""
    weight = sums[:, 9]
    mean = sums[:, :9] / np.where(weight > 0, weight, 1.0)[:, None]
    matrices = np.empty((len(sums), 3, 3))
    for column, (i, j) in enumerate(_SYMMETRIC):
        matrices[:, i, j] = matrices[:, j, i] = mean[:, column]
    return matrices, mean[:, 6:9], weight

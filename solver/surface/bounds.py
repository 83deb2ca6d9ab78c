"""Guaranteed bounds of the surface error.

On a part of a triangle the surface is a sum over its patches, S(b) = sum_k phi_k(b) h_k(u_k(b)), in which the blending
weights phi_k and the domains u_k are linear in the barycentric coordinates b, and h_k is a polynomial.  A Taylor model
(see `taylor`) replaces each h_k by a polynomial of degree m - 1 and a bound of what that leaves out.  The error without
these remainders is a polynomial of degree m, and the largest of its Bernstein coefficients bounds it (convex hull
property; Farin, Curves and Surfaces for CAGD, chapter 17).  Where both together do not suffice the part is split in
four, which divides the remainder by 2^m.  Values at points of the parts, less the remainders, bound the largest error
from below.  Models of a lower degree, which take less time, tell on which triangles the error may be large at all.  The
correction that closes a surface at its creases is linear on a part up to a remainder of its own (see `closing`).  All
of this holds up to the rounding of double precision.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays import any_of, length_of, rows_at
from ..native import bounds as native
from ..processes.each import Each, all_done
from .closing import Closing
from .representation import Representation
from .taylor import LATTICE, ROUGH_LATTICE, DerivativeBounds, Expansions, Lattice

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

ACCURACY = 0.02
"""The largest error is known when its two bounds differ by no more than this share of it."""

MOST_SPLITS = 12
"""How often a part may be split; the last ones are 1 / 4096 of a triangle's side."""

MOST_PARTS = 50_000
"""Parts that are split no further when there are more of them, and more than triangles: their bounds hold, but are
looser."""

ROUNDING = 1e-12
"""Share of the coordinates' size below which an error is rounding, and not worth splitting for."""

PARTS_AT_ONCE = 40_000
"""Parts of triangles, each in each of its patches, that are bounded together: more would only take memory."""

FOUR = (
    np.array(
        [
            [[2, 0, 0], [1, 1, 0], [1, 0, 1]],
            [[1, 1, 0], [0, 2, 0], [0, 1, 1]],
            [[1, 0, 1], [0, 1, 1], [0, 0, 2]],
            [[0, 1, 1], [1, 0, 1], [1, 1, 0]],
        ]
    )
    / 2.0
)
"""Corners of the four parts of a triangle in its barycentric coordinates, (4, 3, 3)."""


def error_bounds(
    representation: Representation,
    vertices: Array | None = None,
    accuracy: float = ACCURACY,
    each: Each = map,
) -> tuple[float, float]:
    """Bounds of the largest distance |S(b) - x(b)| between the surface and the points of the same parameters.

    Parameters
    ----------
    representation
        The surface S.
    vertices
        Corners of the flat triangles of x, (V, 3); the representation's own where None.
    accuracy
        The bounds differ by no more than this share of the upper one, unless that is rounding or `MOST_SPLITS` ends the
        search.
    each
        Bounds parts of the surface, perhaps several at once.

    Returns
    -------
    lower, upper
        Scene units.  The error reaches `lower` somewhere and exceeds `upper` nowhere.
    """
    representation.prepare(each)
    error = _ErrorModel.of(representation, vertices)
    parts = _Parts.whole(np.arange(len(representation.triangles)))
    low, high = error.bounds(parts, ROUGH_LATTICE, each)
    lower = upper = float(low.max(initial=0.0))
    parts = parts.select(high > lower)
    for splits in range(MOST_SPLITS + 1):
        low, high = error.bounds(parts, each=each)
        lower = max(lower, float(low.max(initial=0.0)))
        settled = high <= max(lower * (1.0 + accuracy), error.negligible)
        if splits == MOST_SPLITS or np.count_nonzero(~settled) > max(MOST_PARTS, len(representation.triangles)):
            largest = np.sort(np.argsort(np.where(settled, 0.0, -high), kind="stable")[:MOST_PARTS])
            lower = max(lower, _reached(representation, vertices, parts.select(largest)))
            settled[:] = True
        upper = max(upper, float(high[settled].max(initial=0.0)))
        if settled.all():
            break
        parts = parts.select(~settled).split()
    return lower, max(lower, upper)


def _reached(representation: Representation, vertices: Array | None, parts: _Parts) -> float:
    """Largest error in the middles of parts: a lower bound that no remainder makes smaller."""
    middles = parts.corners.mean(axis=1)
    corners = (representation.vertices if vertices is None else vertices)[representation.triangles[parts.triangle]]
    off = representation.evaluate(parts.triangle, middles) - np.einsum("pk,pkd->pd", middles, corners)
    return float(length_of(off).max(initial=0.0))


def exceeding(
    representation: Representation,
    tolerance: float | Array,
    triangles: Indices | None = None,
    vertices: Array | None = None,
    each: Each = map,
) -> NDArray[np.bool_]:
    """Whether the error may exceed a tolerance, for all triangles (T,) or for those named; False is guaranteed.

    Parameters as of `error_bounds`; `tolerance` in scene units, for all or one for each of those asked for.
    """
    asked = np.arange(len(representation.triangles)) if triangles is None else triangles
    representation.prepare(each)
    error = _ErrorModel.of(representation, vertices)
    outside = np.zeros(len(representation.triangles), dtype=bool)
    allowed = np.zeros(len(outside))
    allowed[asked] = tolerance
    parts = _Parts.whole(asked)
    parts = parts.select(error.bounds(parts, ROUGH_LATTICE, each)[1] > allowed[asked])
    for _ in range(MOST_SPLITS + 1):
        low, high = error.bounds(parts, each=each)
        within = allowed[parts.triangle]
        outside[parts.triangle[low > within]] = True
        undecided = (high > within) & ~outside[parts.triangle]
        parts = parts.select(undecided)
        if not len(parts.triangle) or len(parts.triangle) > max(MOST_PARTS, len(asked)):
            break
        parts = parts.split()
    outside[parts.triangle] = True
    return outside[asked]


@dataclass(frozen=True)
class _Parts:
    """Parts of triangles.

    Attributes
    ----------
    triangle
        Mesh triangle of each part, (P,).
    corners
        The part's corners in the triangle's barycentric coordinates, (P, 3, 3).
    """

    triangle: Indices
    corners: Array

    @classmethod
    def whole(cls, triangles: Indices) -> _Parts:
        return cls(triangles, np.broadcast_to(np.eye(3), (len(triangles), 3, 3)))

    def select(self, which: NDArray[np.bool_] | Indices | slice) -> _Parts:
        return _Parts(self.triangle[which], self.corners[which])

    def split(self) -> _Parts:
        corners = np.matmul(FOUR, self.corners[:, None])
        return _Parts(np.repeat(self.triangle, 4), corners.reshape(-1, 3, 3))


@dataclass(frozen=True)
class _ErrorModel:
    """S(b) - x(b) as polynomials with remainders.

    Attributes
    ----------
    surface
        The representation, moved so that the model's centre is the origin: differences keep their digits.
    flat
        Corners of x, (V, 3), moved alike.
    closing
        What closes the surface along its creases; None where it has none.
    """

    surface: Representation
    flat: Array
    closing: Closing | None

    @classmethod
    def of(cls, representation: Representation, vertices: Array | None) -> _ErrorModel:
        centre = representation.vertices.mean(axis=0) if len(representation.vertices) else np.zeros(3)
        own = representation.vertices - centre
        moved = replace(representation, vertices=own, origins=representation.origins - centre)
        moved.take_cover(representation.computed_cover())
        closing = representation.closing if len(representation.creases) else None
        return cls(moved, own if vertices is None else vertices - centre, closing)

    @property
    def negligible(self) -> float:
        """Errors up to this, scene units, are rounding."""
        sizes = (np.abs(points).max(initial=0.0) for points in (self.surface.vertices, self.flat, self.surface.origins))
        return float(ROUNDING * max(sizes))

    def bounds(self, parts: _Parts, lattice: Lattice = LATTICE, each: Each = map) -> tuple[Array, Array]:
        """Lower and upper bounds of the largest error on each part, (P,) each."""
        lower, upper = np.empty(len(parts.triangle)), np.empty(len(parts.triangle))

        def bound(block: slice) -> None:
            lower[block], upper[block] = self._bounds(parts.select(block), lattice)

        self._prepare()
        all_done(each, bound, self._blocks(parts))
        return lower, upper

    def _prepare(self) -> None:
        """Compute what all blocks share, before several begin at once."""
        surface = self.surface
        _ = surface.native_functions, surface.native_blend, surface.input_weights, surface.holders
        _ = self._derivative_bounds, surface.dictionary
        if self.closing is not None:
            self.closing.prepare()

    def _blocks(self, parts: _Parts) -> Iterator[slice]:
        """Runs of parts that hold together in memory."""
        ends = np.cumsum(np.diff(self.surface.holders.starts)[parts.triangle])
        start = 0
        while start < len(ends):
            before = ends[start - 1] if start else 0
            stop = max(start + 1, int(np.searchsorted(ends, before + PARTS_AT_ONCE, side="right")))
            yield slice(start, stop)
            start = stop

    def _bounds(self, parts: _Parts, lattice: Lattice) -> tuple[Array, Array]:
        surface = self.surface
        if surface.native_functions is not None:
            patches = surface.native_functions, surface.native_blend, surface.holders, self._limits(lattice.order)
            closing = None if self.closing is None else self.closing.natively()
            compared = native.Compared(surface.triangles, self.flat, surface.vertices, surface.input_weights)
            own = native.Parts(parts.triangle, parts.corners)
            return native.bound_parts(*patches, closing, own, compared, (lattice.places, lattice.to_bernstein))
        values, remainder = self._patches_part(parts, lattice)
        shown = np.flatnonzero(any_of(rows_at(surface.input_weights, parts.triangle) != 0.0))
        values[shown] += self._input_values(parts.select(shown), lattice)
        left_out = length_of(remainder)
        if self.closing is not None:
            correction, rest = self.closing.between_corners(parts.triangle, parts.corners)
            values += np.matmul(lattice.places, correction)
            left_out += rest
        coefficients = np.tensordot(values, lattice.to_bernstein, axes=(1, 1))  # (P, 3, n)
        upper = np.sqrt(np.einsum("pdn,pdn->np", coefficients, coefficients).max(axis=0)) + left_out
        lower = np.sqrt(np.einsum("pnd,pnd->np", values, values).max(axis=0)) - left_out
        return np.maximum(lower, 0.0), upper

    def _patches_part(self, parts: _Parts, lattice: Lattice) -> tuple[Array, Array]:
        """Weighted Taylor models of the patches less x at the lattice, (P, n, 3), and their remainders, (P, 3)."""
        surface = self.surface
        part, held = self._pairs(parts.triangle)
        order = np.argsort(surface.patch_of_triangle[held], kind="stable")
        part, held = part[order], held[order]
        values = np.zeros((len(parts.triangle), len(lattice.places), 3))
        remainder = np.zeros((len(parts.triangle), 3))
        weights = np.matmul(parts.corners[part], surface.corner_weights(held)[:, :, None])[:, :, 0]
        flat = np.matmul(parts.corners[part], self.flat[surface.triangles[parts.triangle[part]]])
        taylor, left_out = self._patches_values(held, parts.corners[part], lattice)
        taylor -= np.matmul(lattice.places, flat)
        taylor *= np.matmul(weights, lattice.places.T)[:, :, None]
        _add_rows(values, part, taylor)
        _add_rows(remainder, part, weights.max(axis=1, initial=0.0)[:, None] * left_out)
        return values, remainder

    def _input_values(self, parts: _Parts, lattice: Lattice) -> Array:
        """What the input itself contributes where it shows through, at the lattice, (P, n, 3)."""
        own = self.surface.vertices[self.surface.triangles[parts.triangle]]
        away = np.matmul(parts.corners, own - self.flat[self.surface.triangles[parts.triangle]])
        weights = np.matmul(parts.corners, self.surface.input_weights[parts.triangle][:, :, None])
        return np.matmul(lattice.places, weights) * np.matmul(lattice.places, away)

    def _pairs(self, triangle: Indices) -> tuple[Indices, Indices]:
        """Each part in each of its patches: numbers of the parts and patch triangles, (n,) each."""
        starts, holders, _ = self.surface.holders
        counts = starts[triangle + 1] - starts[triangle]
        ends = np.cumsum(counts)
        within = np.arange(ends[-1] if len(ends) else 0) - np.repeat(ends - counts, counts)
        return np.repeat(np.arange(len(triangle)), counts), holders[np.repeat(starts[triangle], counts) + within]

    def _patches_values(self, held: Indices, corners: Array, lattice: Lattice) -> tuple[Array, Array]:
        """Taylor polynomials of the patches' own surfaces at the lattice, (n, L, 3), and their remainders, (n, 3)."""
        surface = self.surface
        taylor, left_out = np.empty((len(held), len(lattice.places), 3)), np.empty((len(held), 3))
        ends = np.matmul(corners, surface.domains[:, surface.corners[held]])  # (C, n, 3, 2)
        patch = surface.patch_of_triangle[held]
        runs = np.flatnonzero(np.diff(patch, prepend=-1, append=-1))
        scale = surface.scales[patch]
        for c, parameters in enumerate(ends):
            pieces = Expansions(surface.dictionary, parameters, self._derivative_bounds, lattice)
            axes = slice(None) if len(ends) == 1 else slice(c, c + 1)
            values, rest = pieces.of_patches(runs, surface.grids[patch[runs[:-1]], axes])
            taylor[:, :, axes] = (values / scale[:, c, None, None]).transpose(0, 2, 1)
            left_out[:, axes] = rest / scale[:, c, None]
        taylor += surface.origins[patch][:, None]
        return taylor, left_out

    def _limits(self, order: int) -> native.Limits:
        own = self._derivative_bounds
        return native.Limits(own.low, own.width, own.levels[:, : order + 1])

    @cached_property
    def _derivative_bounds(self) -> DerivativeBounds:
        return DerivativeBounds.of(self.surface.dictionary, self.surface.domains)


def _add_rows(total: Array, rows: Indices, values: Array) -> None:
    """Add values (n, ...) to the rows of `total`, in order of the values."""
    order = np.argsort(rows, kind="stable")
    starts = np.flatnonzero(np.diff(rows[order], prepend=-1))
    if len(starts):
        total[rows[order][starts]] += np.add.reduceat(values[order], starts, axis=0)

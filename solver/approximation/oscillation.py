"""Patches of a mesh that oscillate between their observations.

A polynomial may pass near every vertex and centroid and still swing out in between.  Such patches are rare, after the
fit as after the sweeps.  Errors at points that were not observed reveal them; they are refitted by themselves with six
observations in every triangle.  Triangles much larger than their neighbours leave a polynomial more room than that, so
they are looked at closely.  What still swings out there is refitted with lower degrees.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ..arrays import Array, Booleans, Indices, length_of, offsets_of, rows_at, runs_of_rows, slices_of
from ..mesh.sampling import SURFACE_SAMPLES, points_inside, triangle_grid
from ..native import surface as native
from ..patches.observations import MeshObservations
from ..processes.each import Each, all_done
from ..surface.representation import Representation
from .patched_surface import Observing, PatchedSurface

MeshSurface = PatchedSurface[MeshObservations]

NEAR_EDGES = SURFACE_SAMPLES[3:]
"""The samples that are farthest from both vertices and centroid."""

OVERSHOOT = 2.0
"""A patch oscillates where its largest error in between exceeds the largest at its observations by this factor."""

OBSERVED_AT_ONCE = 50_000
"""Observations compared together: more would only take memory."""

UNEVEN = 4.0
"""A triangle is uneven where its longest side in the initial domain exceeds the patch's median by this factor."""

CLOSE = triangle_grid(24)
"""Where uneven triangles are looked at: a polynomial of degree 14 changes sign at most 14 times along a side."""

NEGLIGIBLE = 1e-3
"""Errors below this share of the longest side of their connected piece do not lower a degree."""

DEGREE_FACTOR = 0.6
"""A lower degree is this share of the one before."""


def oscillating_on_mesh(surface: MeshSurface) -> Iterator[tuple[Booleans, MeshObservations]]:
    """Find patches that swing out between their observations (see `refit_oscillating`).

    They are to be observed more densely, then to use lower degrees.  Errors count with the patch's blending weight.
    """
    observed = _errors_observed(surface)
    oscillating = errors_between(surface) > OVERSHOOT * observed
    # of the initial domains: which these are does not change with the fits, and before them nothing is to be assembled
    uneven = UnevenTriangles.of(surface.representation(), surface.runner.each)
    if oscillating.any():
        yield oscillating, surface.observations.with_dense(oscillating)
    patches = surface.patches
    sizes = surface.mesh.piece_sizes[patches.mesh_triangles[patches.triangle_offsets[:-1]]]
    allowed = np.maximum(OVERSHOOT * observed, NEGLIGIBLE * sizes)
    if not uneven.patches.any():
        return

    def error(which: Indices) -> Array:
        return np.array([uneven.largest_error(surface, int(patch)) for patch in which])

    def observe(patches: Booleans, degrees: Indices) -> MeshObservations:
        return surface.observations.with_dense(patches).with_degrees(degrees)

    yield from with_lower_degrees(surface, error, allowed, observe, uneven.patches, lowest=1)


def with_lower_degrees(
    surface: PatchedSurface[Observing],
    error: Callable[[Indices], Array],
    allowed: Array | float,
    observe: Callable[[Booleans, Indices], Observing],
    asked: Booleans | None = None,
    *,
    lowest: int,
    rounds: int = 10,
) -> Iterator[tuple[Booleans, Observing]]:
    """Have patches refitted with lower and lower degrees until their error is allowed (see `refit_oscillating`).

    Of all its fits each patch keeps the one with the smallest error.

    Parameters
    ----------
    error
        Errors of some patches, (n,).
    allowed
        Largest error of each patch that does not cause a refit, (K,) or the same for all.
    observe
        Makes observations from the patches that are to be refitted, (K,), and the degrees of all, (K,).
    asked
        Patches that are looked at, (K,); all where None.
    lowest
        Lowest degree that is tried.
    rounds
        How often a patch is refitted at most.
    """
    which = np.arange(len(surface.patches)) if asked is None else np.flatnonzero(asked)
    degrees = np.minimum(surface.observations.degrees, surface.settings.degree)
    away = np.zeros(len(surface.patches))
    away[which] = error(which)
    best, best_degrees, nearest = surface.fits, degrees, away
    for _ in range(rounds):
        oscillating = (nearest > allowed) & (degrees > lowest)
        if not oscillating.any():
            break
        degrees = np.where(oscillating, np.maximum((DEGREE_FACTOR * degrees).astype(np.int64), lowest), degrees)
        yield oscillating, observe(oscillating, degrees)
        away = away.copy()
        away[oscillating] = error(np.flatnonzero(oscillating))
        better = away < nearest
        nearest, best_degrees = np.where(better, away, nearest), np.where(better, degrees, best_degrees)
        best = [new if other else old for old, new, other in zip(best, surface.fits, better, strict=True)]
    surface.restore(best, surface.observations.with_degrees(best_degrees))


class UnevenTriangles:
    """Triangles that take up much more of their patch's domain than most of its triangles.

    Attributes
    ----------
    patches
        Which patches have some, (K,).
    mesh_triangles
        Their numbers in the mesh, one for each patch that holds them, (n,).
    """

    def __init__(self, uneven: Booleans, representation: Representation) -> None:
        """Take which of the patch triangles are uneven, (S,)."""
        offsets = representation.triangle_offsets
        self._uneven, self._offsets = uneven, offsets
        self.mesh_triangles = representation.mesh_triangles[uneven]
        self.patches = np.add.reduceat(uneven, offsets[:-1]) > 0 if len(offsets) > 1 else np.zeros(0, dtype=bool)

    @classmethod
    def of(cls, representation: Representation, each: Each = map) -> UnevenTriangles:
        """Compare the triangles' longest sides in the initial domains: optimised ones are stretched along creases."""
        offsets, sides = representation.triangle_offsets, np.empty(len(representation.corners))
        table = representation.corners

        def measure(own: slice) -> None:
            one, two, three = (representation.initial_domains[:, corner] for corner in table[own].T)
            squares = [((a - b) ** 2) @ np.ones(2) for a, b in ((one, two), (two, three), (three, one))]
            sides[own] = np.sqrt(np.maximum.reduce(squares).max(axis=0))

        all_done(each, measure, slices_of(len(sides), OBSERVED_AT_ONCE))
        median = _medians(sides, offsets)
        return cls(representation.weighty & (sides > UNEVEN * np.repeat(median, np.diff(offsets))), representation)

    def largest_error(self, surface: MeshSurface, patch: int) -> float:
        """Largest error of a patch on its uneven triangles, scene units."""
        own = np.flatnonzero(self._uneven[slice(*self._offsets[patch : patch + 2])])
        samples, points = surface.observations.samples_of_patch(patch, own, CLOSE)
        error = np.linalg.norm(surface.values_at(patch, samples) - points, axis=1) * samples.blending
        return float(error.max(initial=0.0))


def _medians(values: Array, offsets: Indices) -> Array:
    """The median of each row, (K,), or the larger one of two; rows in one array, split at `offsets`."""
    sizes = np.diff(offsets)
    medians = np.empty(len(sizes))
    for first, end in runs_of_rows(offsets, OBSERVED_AT_ONCE):
        own = sizes[first:end]
        rows = np.full((len(own), own.max()), np.inf)
        rows[np.arange(own.max()) < own[:, None]] = values[offsets[first] : offsets[end]]
        rows.sort(axis=1)
        medians[first:end] = rows[np.arange(len(own)), own // 2]
    return medians


def errors_between(surface: MeshSurface) -> Array:
    """Largest error of each patch between its observations, (K,), scene units."""
    representation, mesh = surface.representation(), surface.mesh
    starts = representation.triangle_offsets[:-1]
    functions, triangles = representation.native_functions, representation.triangles
    if functions is not None:
        where = representation.native_blend
        if representation.blending == "uniform":
            where = where._replace(weights=representation.weights, shares=None)
        errors = np.empty(len(where.corners))

        def measure(run: tuple[int, int]) -> None:
            native.largest_errors(functions, where, run, (mesh.vertices, triangles), NEAR_EDGES, errors)

        all_done(surface.runner.each, measure, runs_of_rows(representation.triangle_offsets, OBSERVED_AT_ONCE))
        return np.maximum.reduceat(errors, starts) if len(starts) else np.zeros(0)
    errors = np.empty(len(representation.mesh_triangles))
    for rows, values in representation.at_patch_samples(NEAR_EDGES):
        flat = points_inside(mesh.vertices, triangles[representation.mesh_triangles[rows]], NEAR_EDGES)
        weights = representation.weights[representation.corners[rows]] @ NEAR_EDGES.T
        errors[rows] = (np.linalg.norm(values - flat, axis=2) * weights).max(axis=1)
    return np.maximum.reduceat(errors, starts) if len(starts) else np.zeros(0)


def _errors_observed(surface: MeshSurface) -> Array:
    fits, observations = surface.fits, surface.observations
    largest = np.zeros(len(fits))
    offsets = offsets_of(np.array([len(fit.values) for fit in fits], dtype=np.int64))

    def measure(run: tuple[int, int]) -> None:
        first, end = run
        number, blending = surface.blends(np.arange(first, end))
        away = np.concatenate([fit.values for fit in fits[first:end]]) - rows_at(observations.places, number)
        error = length_of(away) * blending
        largest[first:end] = np.maximum.reduceat(error, offsets[first:end] - offsets[first])

    all_done(surface.runner.each, measure, runs_of_rows(offsets, OBSERVED_AT_ONCE))
    return largest

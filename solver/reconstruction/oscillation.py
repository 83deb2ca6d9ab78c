"""Patches that oscillate between the points of a cloud.

Where points are few a polynomial of high degree may pass through all of them and swing far out in between.  No residual
reveals that, but the points' tangent planes do.  Such patches are refitted with lower degrees.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ..approximation.patched_surface import PatchedSurface
from ..arrays import Array, Booleans, Indices
from ..mesh.sampling import triangle_grid
from ..patches.blending import PLATEAU
from .observations import CloudObservations
from .tangent_planes import TangentPlanes

CloudSurface = PatchedSurface[CloudObservations]

SAMPLES = triangle_grid(5)
"""Points of each triangle at which a patch is compared with the planes."""

REFITS = 3
DEGREE_FACTOR = 0.6
LOWEST_DEGREE = 2
"""A patch is refitted at most this often, each time with its degree multiplied by this, but never a lower one."""


def oscillating_in_cloud(surface: CloudSurface, planes: TangentPlanes) -> Iterator[tuple[Booleans, CloudObservations]]:
    """Find patches that leave the tangent planes, to be fitted with lower degrees (see `refit_oscillating`).

    Of all its fits each patch keeps the one that stays nearest to the planes.
    """

    def leaving(which: Indices) -> Array:
        return farthest(which, planes, lambda patch: _sampled(surface, patch))

    best, degrees = surface.fits, surface.observations.degrees
    best_degrees = degrees
    nearest = away = leaving(np.arange(len(best)))
    for _ in range(REFITS):
        oscillating = (away > planes.tolerance) & (degrees > LOWEST_DEGREE)
        if not oscillating.any():
            break
        degrees = np.where(oscillating, lowered(degrees), degrees)
        yield oscillating, surface.observations.with_degrees(degrees)
        away = away.copy()
        away[oscillating] = leaving(np.flatnonzero(oscillating))
        better = away < nearest
        nearest, best_degrees = np.where(better, away, nearest), np.where(better, degrees, best_degrees)
        best = [new if other else old for old, new, other in zip(best, surface.fits, better, strict=True)]
    surface.restore(best, surface.observations.with_degrees(best_degrees))


def _sampled(surface: CloudSurface, patch: int) -> tuple[Array, Array]:
    samples = surface.observations.samples_of_patch(patch, SAMPLES)
    return surface.values_at(patch, samples), samples.blending


def farthest(patches: Indices, planes: TangentPlanes, sampled: Callable[[int], tuple[Array, Array]]) -> Array:
    """How far each of these patches leaves the planes of the points around it, (n,), scene units.

    Parameters
    ----------
    patches
        Their numbers, (n,).
    sampled
        Gives a patch's own surface at samples of its triangles, (m, 3), and its blending weights there, (m,).
    """
    pieces = [sampled(int(patch)) for patch in patches]
    away = planes.distance(np.concatenate([points for points, _ in pieces]))
    # At its rim a patch has no weight, but where it is far off there it is off beside the rim too.
    away *= np.concatenate([blending for _, blending in pieces]) + PLATEAU
    starts = np.cumsum([0, *(len(blending) for _, blending in pieces[:-1])])
    result: Array = np.maximum.reduceat(away, starts)
    return result


def lowered(degrees: Indices) -> Indices:
    """Lower degrees for patches that oscillate."""
    return np.maximum((DEGREE_FACTOR * degrees).astype(np.int64), LOWEST_DEGREE)

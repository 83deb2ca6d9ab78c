"""Patches that oscillate between the points of a cloud.

Where points are few a polynomial of high degree may pass through all of them and swing far out in between.  No residual
reveals that, but the points' tangent planes do.  Such patches are refitted with lower degrees.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ..approximation.oscillation import with_lower_degrees
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
LOWEST_DEGREE = 2
"""A patch is refitted at most this often, and never with a lower degree."""


def oscillating_in_cloud(surface: CloudSurface, planes: TangentPlanes) -> Iterator[tuple[Booleans, CloudObservations]]:
    """Find patches that leave the tangent planes, to be fitted with lower degrees (see `refit_oscillating`)."""

    def leaving(which: Indices) -> Array:
        return farthest(which, planes, lambda patch: _sampled(surface, patch))

    def observe(patches: Booleans, degrees: Indices) -> CloudObservations:
        return surface.observations.with_degrees(degrees)

    return with_lower_degrees(surface, leaving, planes.tolerance, observe, lowest=LOWEST_DEGREE, rounds=REFITS)


def _sampled(surface: CloudSurface, patch: int) -> tuple[Array, Array, Array]:
    samples, mesh = surface.observations.samples_of_patch(patch, SAMPLES), surface.mesh
    own = surface.patches.mesh_triangles[slice(*surface.patches.triangle_offsets[patch : patch + 2])]
    on_base = np.einsum("qk,tkd->tqd", SAMPLES, mesh.vertices[mesh.triangles[own]]).reshape(-1, 3)
    return surface.values_at(patch, samples), on_base, samples.blending


def farthest(patches: Indices, planes: TangentPlanes, sampled: Callable[[int], tuple[Array, Array, Array]]) -> Array:
    """How far each of these patches leaves the points around it, (n,), scene units.

    Parameters
    ----------
    patches
        Their numbers, (n,).
    sampled
        Gives a patch's own surface at samples of its triangles and these on the base, (m, 3), and its blending weights
        there, (m,).
    """
    pieces = [sampled(int(patch)) for patch in patches]
    points, on_base, blending = (np.concatenate([piece[k] for piece in pieces]) for k in range(3))
    away = np.maximum(planes.distance(points), planes.run_away(points, on_base))
    # At its rim a patch has no weight, but where it is far off there it is off beside the rim too.
    away *= blending + PLATEAU
    starts = np.cumsum([0, *(len(piece[2]) for piece in pieces[:-1])])
    result: Array = np.maximum.reduceat(away, starts)
    return result

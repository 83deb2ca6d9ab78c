"""Patch size and regularisation for noisy observations: as fine as the noise allows, and no finer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..fitting.chunks import chunk_patches, chunk_task, fit_chunk
from ..fitting.methods import annealing_solver_of
from ..mesh.triangle_mesh import TriangleMesh
from ..patches.blending import blending_weights
from ..patches.cover import build_cover
from ..patches.parameterisation import initial_domains
from ..patches.patches import build_patches
from ..settings import Settings
from .geometry import CloudGeometry
from .observations import CloudObservations, ObservedCloud

Array = NDArray[np.float64]

RINGS = (1, 2, 3)
CLEAN = 0.02
"""Noise below this share of the spacing counts as none."""

PATCHES_ASKED = 48
LARGEST_SHIFT = 0.1
"""By how much the domain is expected to move, in patch radii: the prior from which regularisation follows where data is
noisy."""


def ring_for_noise(mesh: TriangleMesh, cloud: ObservedCloud, geometry: CloudGeometry, settings: Settings) -> int:
    """Patch radius with the least expected error across the surface (Mallows 1973): 1 where there is hardly any noise.

    A patch's risk is its mean squared residual less the noise's variance, plus twice the variance for each share that a
    function has of the points: what the residual would be on new points.  Patches are fitted over their initial domains
    for this.
    """
    if geometry.noise <= CLEAN * geometry.spacing:
        return RINGS[0]
    risks = [_risk(mesh, cloud, geometry, settings, ring) for ring in RINGS]
    return RINGS[int(np.argmin(risks))]


def _risk(mesh: TriangleMesh, cloud: ObservedCloud, geometry: CloudGeometry, settings: Settings, ring: int) -> float:
    patches = build_patches(mesh, build_cover(mesh, ring), ring)
    blending = blending_weights(mesh, patches, settings.blending)
    observations = CloudObservations(mesh, patches, blending, settings.blending, cloud)
    domains = initial_domains(mesh, patches, settings.initial_domain)
    quick = replace(settings, method="default", iterations=0, domains="common")
    asked = np.unique(np.linspace(0, len(patches) - 1, min(PATCHES_ASKED, len(patches))).astype(np.int64))
    variance, count = geometry.noise**2, len(geometry.normals)
    total = weight = 0.0
    for chunk in chunk_patches(observations, asked):
        for patch, fit in zip(chunk, fit_chunk(chunk_task(observations, domains, quick, chunk)), strict=True):
            own = observations.of_patch(int(patch))
            known = own.number < count
            if not known.any():
                continue
            normals = geometry.normals[own.number[known]]
            across = ((cloud.points[own.number[known]] - fit.values[known]) * normals).sum(axis=1)
            share = own.blending[known] * own.weights[known]
            functions = ((fit.support >= 0).sum(axis=1) * (normals**2).mean(axis=0)).sum()
            residual = (share * across**2).sum() / max(share.sum(), 1e-300)
            risk = residual + (2.0 * functions / known.sum() - 1.0) * variance
            total, weight = total + share.sum() * risk, weight + share.sum()
    return total / max(weight, 1e-300)


def iterations_for_noise(settings: Settings, relative_noise: float) -> int:
    """Iterations after which the annealed regularisation has come down to what noisy data call for.

    With noise of standard deviation s, in patch radii, and domains expected to move by d the most probable domain
    minimises |residual|^2 + (s / d)^2 |U - U0|^2: going below that weight would fit the domain to the noise.
    """
    solver = annealing_solver_of(settings)
    if solver is None or relative_noise <= 0.0 or settings.beta1 <= 0.0:
        return settings.iterations
    return solver.iterations_down_to(settings, (relative_noise / LARGEST_SHIFT) ** 2)

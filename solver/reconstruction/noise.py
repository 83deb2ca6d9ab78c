"""Patch size and regularisation for noisy observations: as fine as the noise allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..approximation.patched_surface import PatchedSurface, cover
from ..approximation.runner import ChunkRunner
from ..fitting.methods import annealing_solver_of
from ..mesh.triangle_mesh import TriangleMesh
from ..patches.parameterisation import initial_domains
from ..settings import Settings
from .geometry import CloudGeometry
from .observations import ObservedCloud, observer

RINGS = (1, 2, 3)
"""Patch radii to choose from, in edges of the base."""

NEGLIGIBLE_NOISE = 0.02
"""Noise below this share of the spacing counts as none."""

PATCHES_ASKED = 48
"""Patches from which the error of a radius is estimated."""

NEARLY_LEAST = 0.35
"""Of radii whose risks exceed the least by less than this share of the noise's variance the largest is taken: fits that
move their domains follow the surface better than the estimate says, and larger patches reach across gaps."""

CLOSER = 1
"""In noise there are as many patches as rings smaller by this would need: with more patches at each place, more of what
noise does to each of them is averaged away (bagging, Breiman 1996)."""

LARGEST_SHIFT = 0.1
"""How far the domain is expected to move, in patch radii: the prior that sets the regularisation for noisy data."""


def is_noisy(geometry: CloudGeometry) -> bool:
    """Whether the noise of a cloud counts."""
    return geometry.noise > NEGLIGIBLE_NOISE * geometry.spacing


def ring_for_noise(
    mesh: TriangleMesh, cloud: ObservedCloud, geometry: CloudGeometry, settings: Settings, runner: ChunkRunner
) -> int:
    """Patch radius with the least expected error across the surface (Mallows 1973): 1 where there is hardly any noise.

    A patch's risk is its mean squared residual minus the noise's variance, plus twice the variance times the functions
    per point: what the residual would be on new points.  For this patches are fitted over their initial domains.
    """
    if not is_noisy(geometry):
        return RINGS[0]
    risks = [_risk(mesh, cloud, geometry, settings, ring, runner) for ring in RINGS]
    good = np.flatnonzero(np.array(risks) <= min(risks) + NEARLY_LEAST * geometry.noise**2)
    return RINGS[int(good[-1])]


def _risk(
    mesh: TriangleMesh,
    cloud: ObservedCloud,
    geometry: CloudGeometry,
    settings: Settings,
    ring: int,
    runner: ChunkRunner,
) -> float:
    patches = cover(mesh, ring)
    quick = replace(settings, method="default", iterations=0, domains="common")
    domains = initial_domains(mesh, patches, settings.initial_domain)
    surface = PatchedSurface(mesh, patches, domains, observer(mesh, quick, cloud), quick, runner)
    asked = np.unique(np.linspace(0, len(patches) - 1, min(PATCHES_ASKED, len(patches))).astype(np.int64))
    for _ in surface.refit(asked, surface.observations):
        pass
    variance, count = geometry.noise**2, len(geometry.normals)
    total = weight = 0.0
    for patch, fit in zip(asked, surface.fits, strict=True):
        own = surface.observations.of_patch(int(patch))
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
    """Iterations after which the annealed regularisation has fallen to what noisy data require.

    With noise of standard deviation s, in patch radii, and domains expected to move by d the most probable domain
    minimises |residual|^2 + (s / d)^2 |U - U0|^2: going below that weight would fit the domain to the noise.
    """
    solver = annealing_solver_of(settings)
    if solver is None or relative_noise <= 0.0 or settings.beta1 <= 0.0:
        return settings.iterations
    return solver.iterations_down_to(settings, (relative_noise / LARGEST_SHIFT) ** 2)

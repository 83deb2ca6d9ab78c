"""Automatic ring: patches whose initial domain is badly squeezed are split before anything is fitted to them.

A conformal map squeezes fingers and ears into a few specks of the domain, where no polynomial of moderate degree can
follow the surface.  Smaller rings cut such features into pieces that lie flat.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices
from ..mesh.triangle_mesh import TriangleMesh
from ..processes.each import Each
from ..settings import Settings
from .parameterisation import domain_quality, initial_domains
from .patches import Patches, refine_patches

SQUEEZED = 0.1
"""A patch is split where the 2nd percentile of its area ratios falls below this share of their median."""

SMALLER_RINGS = (4, 3, 2, 1)
SMALLEST_SQUEEZED_RING = 2


def with_domains(mesh: TriangleMesh, patches: Patches, settings: Settings, each: Each = map) -> tuple[Patches, Array]:
    """Map each patch to the plane, splitting those that are badly squeezed.

    Without `settings.adaptive` only those are split that no map can hold, such as a plane with a long thin finger.

    Returns
    -------
    patches, domains
        Domains in scene units, (M, 2).
    """
    domains = initial_domains(mesh, patches, settings.initial_domain, each)
    smallest = _smallest_rings(mesh, patches, domains, settings, each)
    for ring in SMALLER_RINGS:
        bad = (patches.rings > ring) & (smallest <= ring)
        if ring >= settings.ring or not bad.any():
            continue
        refined, new = refine_patches(mesh, patches, bad, ring)
        added = refined.select(new)
        kept = np.repeat(~bad, np.diff(patches.vertex_offsets))
        fresh = initial_domains(mesh, added, settings.initial_domain, each)
        smallest = np.concatenate([smallest[~bad], _smallest_rings(mesh, added, fresh, settings, each)])
        patches, domains = refined, np.concatenate([domains[kept], fresh])
    return patches, domains


def _smallest_rings(mesh: TriangleMesh, patches: Patches, domains: Array, settings: Settings, each: Each) -> Indices:
    """Return down to which ring each patch may be split, (K,); a good one is not split at all."""
    quality = domain_quality(mesh, patches, domains, each)
    squeezed = quality.squeeze < SQUEEZED if settings.adaptive else np.zeros(len(patches), dtype=bool)
    return np.where(quality.unusable, 1, np.where(squeezed, SMALLEST_SQUEEZED_RING, settings.ring))

"""Automatic ring: patches whose initial domain is badly squeezed are split before anything is fitted to them.

A conformal map squeezes fingers and ears into a few specks of the domain, where no polynomial of moderate degree can follow the
surface.  Smaller rings cut such features into pieces that lie flat.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .initial_domains import initial_domains, squeeze
from .mesh import TriangleMesh
from .patches import Patches, refine_patches
from .settings import Settings

SQUEEZED = 0.1
"""A patch is split where the 2nd percentile of its area ratios falls below this share of their median."""

SMALLER_RINGS = (4, 3, 2)


def with_domains(
    mesh: TriangleMesh, patches: Patches, settings: Settings
) -> tuple[Patches, NDArray[np.float64]]:
    """Map each patch to the plane, splitting those that are badly squeezed.

    Returns
    -------
    patches, domains
        Domains in scene units, (M, 2).
    """
    domains = initial_domains(mesh, patches, settings.initial_domain)
    if not settings.adaptive:
        return patches, domains
    for ring in SMALLER_RINGS:
        if ring >= settings.ring:
            continue
        bad = (squeeze(mesh, patches, domains) < SQUEEZED) & (patches.rings > ring)
        if not bad.any():
            break
        refined, new = refine_patches(mesh, patches, bad, ring)
        kept = np.repeat(~bad, np.diff(patches.vertex_offsets))
        fresh = initial_domains(mesh, refined.select(new), settings.initial_domain)
        patches, domains = refined, np.concatenate([domains[kept], fresh])
    return patches, domains

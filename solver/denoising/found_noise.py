"""The noise that is found in a mesh, with all that is known of it, and whether it is removed."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..mesh.input_checks import as_positions, checked_edges
from ..mesh.potential_creases import cut_along_marked
from ..mesh.triangle_mesh import TriangleMesh, build_mesh
from .noise_level import estimate_noise_level, mean_edge_length, smoothed_normals
from .noise_spectrum import correlated_noise
from .scan_structure import ONLY_LINES, depth_rounding, scan_lines
from .surface import Surface, build_surface

CLEAN = 0.03
"""Relief below this share of the mean edge length counts as the mesh's own and stays ..."""

EVEN = 0.25
"""... unless it is more even than this (see `NoiseEstimate`), as only noise is, and above a third of that share."""

_ISOTROPIC = 0.5  # of the noise along the normals: with more within the surface, vertices may be off in all directions


@dataclass(frozen=True)
class FoundNoise:
    """What was found.

    Attributes
    ----------
    level
        Standard deviation along the normals, scene units.
    least
        The least level that is removed.
    is_clean
        Whether there is none to be removed: what was found is shape.
    sideways
        Whether vertices may be off within the surface, too.
    inflation, length
        As in `CorrelatedNoise`; 1 and 0 for independent noise.
    """

    level: float
    least: float
    is_clean: bool
    sideways: bool
    inflation: float = 1.0
    length: float = 0.0


def find_noise(mesh: TriangleMesh, surface: Surface) -> FoundNoise:
    """Return the noise of a mesh, found from the mesh alone."""
    edge = mean_edge_length(mesh)
    estimate = estimate_noise_level(mesh, surface)
    least = (CLEAN if estimate.unevenness > EVEN else CLEAN / 3) * edge
    sideways = estimate.along_surface > _ISOTROPIC * estimate.level
    rounding = depth_rounding(mesh)
    if rounding < CLEAN * edge:
        rounding = 0.0  # too little to be removed
    lines = scan_lines(mesh, estimate.relief) if len(estimate.relief) else 0.0
    is_pattern = estimate.is_pattern_of_lines if lines >= ONLY_LINES else estimate.is_pattern
    if rounding == 0.0 and (is_pattern or estimate.level < least):
        return FoundNoise(estimate.level, least, True, sideways)
    correlated = correlated_noise(mesh, smoothed_normals(mesh), has_lines=lines > 0)
    if correlated is None:
        return FoundNoise(max(estimate.level, rounding), least, False, sideways)
    level = max(correlated.level, rounding)
    return FoundNoise(level, least, False, sideways, correlated.inflation, correlated.length)


def removable_noise(
    vertices: ArrayLike, faces: ArrayLike | list[list[int]], sharp_edges: ArrayLike | None = None
) -> float:
    """Return the noise level that `denoise` finds in a mesh, scene units; 0 where it leaves the mesh as it is."""
    mesh = build_mesh(as_positions(vertices), faces)
    marked = checked_edges(sharp_edges, len(mesh.vertices))
    found = find_noise(mesh, build_surface(mesh, cut_along_marked(mesh, marked) if len(marked) else None))
    return 0.0 if found.is_clean or found.level < found.least else found.level

"""Keeping a tolerance: finer patches where the surface error exceeds it, and only there.

Where the surface is too far from the input, a patch of a smaller ring is laid over it.  Finer patches outweigh what
lies below them and fade out at their rims, so the surface stays continuous and nothing else changes.  Smaller rings
come first, then more functions; what still lies outside at the end passes through: the surface is then the input
itself at these vertices.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..fitting.chunks import ChunkTask, PatchFit, chunk_patches, chunk_task
from ..mesh.sampling import LATTICE, SURFACE_SAMPLES
from ..mesh.triangle_mesh import TriangleMesh
from ..patches.blending import blending_weights
from ..patches.observations import MeshObservations
from ..patches.parameterisation import initial_domains
from ..patches.patches import Patches, overlay_patches
from ..progress import FINISH, Progress, Steps
from ..settings import Settings
from ..surface.assembly import assemble
from ..surface.metrics import surface_error
from ..surface.representation import Representation

Array = NDArray[np.float64]
Booleans = NDArray[np.bool_]
Run = Callable[[Iterable[ChunkTask]], Iterator[tuple[ChunkTask, list[PatchFit]]]]

LADDER = ((4, 1), (3, 1), (2, 2), (2, 4), (1, 4))
"""Ring, and sparsity as a multiple of the setting, of one round after the other."""

MARGIN = 0.97
"""Share of the tolerance that is aimed at, for the places between those that are measured."""

DENSE_SAMPLES = np.concatenate([SURFACE_SAMPLES, LATTICE])
"""Where the error is compared with the tolerance: also on the edges and at the corners."""

TRIANGLES_AT_ONCE = 50_000

HIDDEN = 1e-2
"""A patch that nowhere has more weight than this is dropped."""


@dataclass
class RefinedSurface:
    """A surface while it is refined.

    Attributes
    ----------
    mesh, patches, weights
        The cover with its blending weights (M,).
    fits
        What each patch has.
    rounds
        What each round took: ring, sparsity, number of patches added.
    """

    mesh: TriangleMesh
    patches: Patches
    weights: Array
    fits: list[PatchFit]
    rounds: list[dict[str, int]] = field(default_factory=list)

    def representation(self, settings: Settings) -> Representation:
        """What evaluates the surface as it stands."""
        return assemble(self.mesh, self.patches, self.weights, self.fits, settings)


def keep_tolerance(
    surface: RefinedSurface, settings: Settings, observation_weights: Array | None, run: Run
) -> Steps[dict[str, Any]]:
    """Refine `surface` until its error is within `settings.tolerance` at every measured point.

    Parameters
    ----------
    surface
        Changed in place.
    settings
        Resolved settings with a tolerance, in scene units, and partition-of-unity blending.
    observation_weights
        Weights of the vertices, (V,); None for ones.
    run
        Fits chunks, in order.

    Returns
    -------
    dict
        What it took, for the report.
    """
    outside = _outside(surface, settings, np.ones(len(surface.mesh.triangles), dtype=bool))
    before = int(outside.sum())
    finish = False
    for level, (ring, factor) in enumerate(LADDER, start=1):
        if not outside.any() or finish:
            break
        if ring >= settings.ring and factor == 1:
            continue
        richer = replace(settings, sparsity=min(settings.sparsity * factor, 496))
        added = yield from _lay_over(surface, outside, ring, level, richer, observation_weights, run)
        changed = np.zeros(len(outside), dtype=bool)
        changed[added.mesh_triangles] = True
        outside = (outside & ~changed) | _outside(surface, settings, changed)
        surface.rounds.append({"ring": ring, "sparsity": richer.sparsity, "patches": len(added)})
        request = yield Progress(
            "Keeping the tolerance", level / (len(LADDER) + 1), f"{int(outside.sum())} triangles left"
        )
        finish = request == FINISH
    reproduced = _pass_through(surface, settings, outside)
    _drop_hidden(surface)
    return {
        "requested": settings.tolerance,
        "triangles_outside_at_first": before,
        "rounds": surface.rounds,
        "vertices_reproduced": reproduced,
    }


def _outside(surface: RefinedSurface, settings: Settings, asked: Booleans) -> Booleans:
    """Triangles among those asked for whose error somewhere exceeds the tolerance, (T,)."""
    triangles = np.flatnonzero(asked)
    representation = surface.representation(settings)
    result = np.zeros(len(asked), dtype=bool)
    for part in np.array_split(triangles, 1 + len(triangles) // TRIANGLES_AT_ONCE):
        error = surface_error(representation, part, DENSE_SAMPLES).max(axis=1, initial=0.0)
        result[part] = error > MARGIN * settings.tolerance
    return result


def _lay_over(
    surface: RefinedSurface,
    outside: Booleans,
    ring: int,
    level: int,
    settings: Settings,
    observation_weights: Array | None,
    run: Run,
) -> Steps[Patches]:
    """Lay patches of a smaller ring over the triangles outside, and fit them; returns the new ones."""
    mesh, count = surface.mesh, len(surface.patches)
    wanted = np.zeros(len(mesh.vertices), dtype=bool)
    wanted[mesh.triangles[outside]] = True
    surface.patches = overlay_patches(mesh, surface.patches, wanted, ring, level)
    surface.weights = blending_weights(mesh, surface.patches, settings.blending)
    number = np.arange(count, len(surface.patches))
    new = surface.patches.select(number)
    own_weights = surface.weights[surface.patches.vertex_offsets[count] :]
    inside = settings.observations == "centroids"
    observations = MeshObservations(mesh, new, own_weights, settings.blending, observation_weights, inside)
    domains = initial_domains(mesh, new, settings.initial_domain)
    fits: dict[int, PatchFit] = {}
    chunks = chunk_patches(observations, np.arange(len(new)), settings.channels)
    for task, fitted in run(chunk_task(observations, domains, settings, chunk) for chunk in chunks):
        fits.update(zip(map(int, task.patches), fitted, strict=True))
        share = (level - 1 + len(fits) / len(new)) / (len(LADDER) + 1)
        yield Progress("Keeping the tolerance", share, f"{len(fits)} of {len(new)} finer patches")
    surface.fits = surface.fits + [fits[k] for k in range(len(new))]
    return new


def _pass_through(surface: RefinedSurface, settings: Settings, outside: Booleans) -> int:
    """Let vertices through until nothing is outside; returns how many it took."""
    mesh = surface.mesh
    reproduced = np.zeros(len(mesh.vertices), dtype=bool)
    while outside.any():
        vertices = np.zeros(len(mesh.vertices), dtype=bool)
        vertices[mesh.triangles[outside]] = True
        if (vertices <= surface.patches.passed_through).all():
            break  # it is the input itself: what is left is rounding, which a tolerance may be below
        reproduced |= vertices
        surface.patches = surface.patches.passing(vertices)
        surface.weights = blending_weights(mesh, surface.patches, settings.blending)
        outside = _outside(surface, settings, np.asarray(vertices[mesh.triangles].any(axis=1)))
    return int((reproduced & ~mesh.passed_through).sum())


def _drop_hidden(surface: RefinedSurface) -> None:
    """Take away patches that finer ones cover altogether."""
    patches = surface.patches
    highest = np.zeros(len(patches))
    np.maximum.at(highest, patches.vertex_patch, surface.weights)
    kept = np.flatnonzero(highest > HIDDEN)
    surface.patches = patches.select(kept)
    surface.fits = [surface.fits[k] for k in kept]
    surface.weights = blending_weights(surface.mesh, surface.patches, "partition")

"""Keeping a tolerance: finer patches where the surface error exceeds it, and only there.

Where the surface is too far from the input, a patch of a smaller ring is laid over it.  Finer patches outweigh what
lies below them and fade out at their rims, so the surface stays continuous and nothing else changes.  Smaller rings
come first, then more functions.  What still lies outside at the end passes through: the surface is then the input
itself at these vertices.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ..arrays import Booleans
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import FINISH, Progress, Steps, within
from ..surface.bounds import exceeding
from ..surface.representation import Representation
from .oscillation import MeshSurface

LADDER = ((4, 1), (3, 1), (2, 2), (2, 4), (1, 4))
"""Ring, and sparsity as a multiple of the setting, of one round after the other."""

MOST_FUNCTIONS = 496
"""Polynomials in the largest dictionary, that of total degree 30."""

MARGIN = 0.999
"""Share of the tolerance that is aimed at: results are stored in single precision."""

HIDDEN = 1e-2
"""A patch that nowhere has more weight than this is dropped."""


@dataclass(frozen=True)
class ToleranceKept:
    """What it took to keep a tolerance.

    Attributes
    ----------
    requested
        The tolerance, scene units.
    triangles_outside_at_first
        Triangles with an error above it before the first round.
    rounds
        Ring, sparsity and number of patches of each round.
    vertices_reproduced
        Vertices at which the surface became the input itself.
    """

    requested: float
    triangles_outside_at_first: int
    rounds: list[dict[str, int]]
    vertices_reproduced: int

    def as_dict(self, achieved: float) -> dict[str, Any]:
        """Return the fields with the largest error that was achieved, scene units."""
        return {**asdict(self), "achieved": achieved}


def keep_tolerance(surface: MeshSurface) -> Steps[ToleranceKept]:
    """Refine a fitted surface until its error is guaranteed to be within `settings.tolerance` (see `surface.bounds`).

    The tolerance is in scene units; blending must be a partition of unity.  Changes `surface`.
    """
    settings = surface.settings
    outside = _outside(surface, np.ones(len(surface.mesh.triangles), dtype=bool))
    before = int(outside.sum())
    rounds: list[dict[str, int]] = []
    for level, (ring, factor) in enumerate(LADDER, start=1):
        if not outside.any():
            break
        if ring >= settings.ring and factor == 1:
            continue
        richer = replace(settings, sparsity=min(settings.sparsity * factor, MOST_FUNCTIONS))
        start, end = (level - 1) / (len(LADDER) + 1), level / (len(LADDER) + 1)
        added = yield from within(surface.lay_over(outside, ring, level, richer), start, end)
        changed = np.zeros(len(outside), dtype=bool)
        changed[added.mesh_triangles] = True
        changed |= _across_creases(surface.mesh, changed)
        outside = (outside & ~changed) | _outside(surface, changed)
        rounds.append({"ring": ring, "sparsity": richer.sparsity, "patches": len(added)})
        request = yield Progress("Keeping the tolerance", end, f"{int(outside.sum())} triangles left")
        if request == FINISH:
            break
    changed = _drop_hidden(surface, HIDDEN)
    outside = (outside & ~changed) | _outside(surface, changed)
    reproduced = _pass_through(surface, outside)
    _drop_hidden(surface, 0.0)
    return ToleranceKept(settings.tolerance, before, rounds, reproduced)


def lowered_to(tolerance: float, bounds: tuple[float, float], representation: Representation) -> tuple[float, float]:
    """Lower the upper of an error's bounds, known to a few per cent, to a tolerance that the surface provably keeps."""
    lower, upper = bounds
    within = MARGIN * tolerance
    if lower <= within < upper and not exceeding(representation, within).any():
        return lower, within
    return bounds


def _outside(surface: MeshSurface, asked: Booleans) -> Booleans:
    """Triangles among those asked for whose error may exceed the tolerance somewhere, (T,)."""
    triangles = np.flatnonzero(asked)
    result = np.zeros(len(asked), dtype=bool)
    result[triangles] = exceeding(
        surface.representation(), MARGIN * surface.settings.tolerance, triangles, each=surface.runner.each
    )
    return result


def _across_creases(mesh: TriangleMesh, changed: Booleans) -> Booleans:
    """Triangles at the creases of changed ones, (T,): the surface is the mean of both sides there."""
    touched = np.zeros(len(mesh.vertices), dtype=bool)
    touched[mesh.triangles[changed]] = True
    on_crease = np.zeros(len(mesh.vertices), dtype=bool)
    on_crease[mesh.creases] = True
    return np.asarray((touched & on_crease)[mesh.triangles].any(axis=1))


def _pass_through(surface: MeshSurface, outside: Booleans) -> int:
    """Let vertices through until nothing is outside; returns how many it took."""
    mesh = surface.mesh
    reproduced = np.zeros(len(mesh.vertices), dtype=bool)
    while outside.any():
        vertices = np.zeros(len(mesh.vertices), dtype=bool)
        vertices[mesh.triangles[outside]] = True
        if (vertices <= surface.patches.passed_through).all():
            break  # the surface is the input already; a tolerance may be smaller than the rounding that is left
        reproduced |= vertices
        surface.pass_through(vertices)
        outside = _outside(surface, np.asarray(vertices[mesh.triangles].any(axis=1)))
    return int((reproduced & ~mesh.passed_through).sum())


def _drop_hidden(surface: MeshSurface, largest: float) -> Booleans:
    """Take away patches whose weight is nowhere larger; returns which triangles they held, (T,)."""
    highest = np.zeros(len(surface.patches))
    np.maximum.at(highest, surface.patches.vertex_patch, surface.blending)
    changed = np.zeros(len(surface.mesh.triangles), dtype=bool)
    changed[surface.patches.select(np.flatnonzero(highest <= largest)).mesh_triangles] = True
    surface.select(np.flatnonzero(highest > largest))
    return changed | _across_creases(surface.mesh, changed)

"""Keeping a tolerance: finer patches where the surface error exceeds it, and only there.

Where the surface is too far from the input, a patch of a smaller ring is laid over it.  Finer patches outweigh what
lies below them and fade out at their rims, so the surface stays continuous and nothing else changes.  Smaller rings
come first, then more functions.  What still lies outside at the end passes through: the surface is then the input
itself at these vertices.  At last those finer patches go that the others can do without.
"""

from __future__ import annotations

from copy import copy
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Booleans, Indices
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


WORTH_A_LOOK = 0.02
"""Share of all patches below which what a look takes away ends the search for patches that are not needed."""

LADDER_ENDS = len(LADDER) / (len(LADDER) + 1)
"""Share of the progress after the last round."""


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
    request = None
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
    if request != FINISH:
        yield from _drop_needless(surface)
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


def _drop_needless(surface: MeshSurface) -> Steps[None]:
    """Take away finer patches without which the error stays guaranteed to be within the tolerance.

    Those whose nodes others hold as well are tried in the order of their weight; together those that have no part in
    the same triangle.  Patches of the first cover stay: where the tolerance is wide they are what fits well.  Sent
    `FINISH`, it goes no further.
    """
    patches = surface.patches
    parts, count = _parts(surface), len(patches)
    kept, untried = np.ones(count, dtype=bool), patches.levels > 0
    order = np.argsort(np.bincount(patches.vertex_patch, surface.blending, count), kind="stable")
    while len(group := _apart(parts, order[(_held_by_others(surface, kept) & untried)[order]])):
        request = yield Progress("Keeping the tolerance", LADDER_ENDS, f"{int(untried.sum())} patches to look at")
        if request == FINISH:
            break
        kept[group] = untried[group] = False
        asked = np.zeros(len(surface.mesh.triangles), dtype=bool)
        asked[parts[group].indices] = True
        without = copy(surface)
        without.select(np.flatnonzero(kept))
        outside = _outside(without, asked)
        kept[group] = parts[group] @ outside > 0
        if len(group) - int(kept[group].sum()) < WORTH_A_LOOK * count:
            break
    surface.select(np.flatnonzero(kept))


def _held_by_others(surface: MeshSurface, kept: Booleans) -> Booleans:
    """Which of the kept patches hold no node alone, (K,)."""
    patches = surface.patches
    holds = kept[patches.vertex_patch] & (surface.blending > 0.0)
    holders = np.bincount(patches.nodes[holds], minlength=surface.mesh.node_count)
    alone = holds & (holders[patches.nodes] == 1)
    return kept & (np.bincount(patches.vertex_patch, alone, len(patches)) == 0)


def _parts(surface: MeshSurface) -> csr_array:
    """Ones where a patch has a part in a triangle, (K, T): its own, and those at the creases that it touches."""
    patches, mesh = surface.patches, surface.mesh
    count, triangles = len(patches), len(mesh.triangles)
    own = csr_array(
        (np.ones(len(patches.mesh_triangles)), (patches.triangle_patch, patches.mesh_triangles)),
        shape=(count, triangles),
    )
    on_crease = np.zeros(len(mesh.vertices), dtype=bool)
    on_crease[mesh.creases] = True
    corner, touched = on_crease[mesh.triangles].ravel(), on_crease[patches.vertices]
    at = np.repeat(np.arange(triangles), 3)[corner], mesh.triangles.ravel()[corner]
    around = csr_array((np.ones(len(at[0])), at[::-1]), shape=(len(mesh.vertices), triangles))
    on = patches.vertex_patch[touched], patches.vertices[touched]
    return own + csr_array((np.ones(len(on[0])), on), shape=(count, len(mesh.vertices))) @ around


def _apart(parts: csr_array, patches: Indices) -> Indices:
    """Take some patches, in the given order, so that no two have a part in the same triangle."""
    taken, chosen = np.zeros(parts.shape[1], dtype=bool), []
    for patch in patches:
        part = parts.indices[parts.indptr[patch] : parts.indptr[patch + 1]]
        if not taken[part].any():
            taken[part] = True
            chosen.append(int(patch))
    return np.array(chosen, dtype=np.int64)


def _drop_hidden(surface: MeshSurface, largest: float) -> Booleans:
    """Take away patches whose weight is nowhere larger; returns which triangles they held, (T,)."""
    highest = np.zeros(len(surface.patches))
    np.maximum.at(highest, surface.patches.vertex_patch, surface.blending)
    changed = np.zeros(len(surface.mesh.triangles), dtype=bool)
    changed[surface.patches.select(np.flatnonzero(highest <= largest)).mesh_triangles] = True
    surface.select(np.flatnonzero(highest > largest))
    return changed | _across_creases(surface.mesh, changed)

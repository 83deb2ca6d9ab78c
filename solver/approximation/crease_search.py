"""Creases that the domain optimisation reveals, and the mesh cut along them.

Smooth functions over one domain cannot have a crease: their tangent planes on both sides of an edge are the same.  But
after two steps of the optimisation the domain is stretched across a crease, and the surface turns there.  So patches
over the potential creases are fitted for two steps, and what they show decides which chains are creases.  Steep edges
between calm faces speak for themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..arrays import Array, Booleans, any_of, folded, offsets_of
from ..mesh.edges import stable_order
from ..mesh.potential_creases import PotentialCreases, potential_creases
from ..mesh.triangle_mesh import TriangleMesh, cut_along
from ..patches.cover import build_cover
from ..patches.observations import MeshObservations
from ..patches.patches import Patches, build_patches
from ..patches.splitting import with_domains
from ..processes.memory import give_back
from ..progress import Steps
from ..settings import Settings
from ..surface.creases import CREASE_DEGREES, CREASE_STRETCH, edge_stretch, turn_at_edges
from .patched_surface import PatchedSurface
from .runner import ChunkRunner

LOOK = 2
"""Steps of the domain optimisation after which creases can be told from what merely bends."""

SEED_DEGREES = 15.0
"""Least angle between the fitted normals beside an edge that speaks for a crease."""

SEEDS = 0.45
"""Share of a crease's edges that must speak for it.  Noise and narrow smooth folds reach 0.43, creases have 0.48."""

STRONG_SEEDS = 2
"""How many of them must turn by `CREASE_DEGREES`."""

ROUNDS = 3
"""How often edges that join creases are added."""

SHORTEST_END = 3
"""Ends of creases with fewer edges, from the last junction on, are taken off."""

DEFAULTS = Settings()

Observe = Callable[[Patches, Array], MeshObservations]


def observing(mesh: TriangleMesh, settings: Settings, weights: Array | None = None) -> Observe:
    """What observes the mesh's vertices and the points inside its triangles."""
    inside, curved = settings.observations == "centroids", settings.domains == "separate"

    def observe(patches: Patches, blending: Array) -> MeshObservations:
        return MeshObservations(mesh, patches, blending, settings.blending, weights, inside, curved)

    return observe


def looking(settings: Settings) -> Settings:
    """The settings with which creases are looked for: with a domain for each coordinate, those of one for all three.

    What is a crease does not depend on how closely patches are fitted, and this takes a sixth of the time.
    """
    if settings.channels == 1:
        return settings
    names = ("domains", "ring", "sparsity", "beta1", "beta2")
    return replace(settings, **{name: getattr(DEFAULTS, name) for name in names})


def cut_along_creases(
    mesh: TriangleMesh, observe: Observe, settings: Settings, runner: ChunkRunner
) -> Steps[tuple[TriangleMesh, bool]]:
    """Cut a mesh along the creases that patches over its potential creases show; without any it stays as it is.

    Also says whether `FINISH` was sent; then it stays as it is, too.
    """
    creases, hurry = yield from _shown(potential_creases(mesh), mesh, observe, settings, runner)
    give_back(len(mesh.vertices))  # what was fitted is forgotten
    return mesh if hurry or not creases.any() else cut_along(mesh, creases), hurry


def find_creases(mesh: TriangleMesh, triangles: Booleans, settings: Settings) -> Steps[tuple[Booleans, bool]]:
    """Return the edges on creases between some of the triangles, (T,), as (E,), and whether `FINISH` was sent."""
    between = (mesh.edge_triangles[:, 1] >= 0) & triangles[mesh.edge_triangles].all(axis=1)
    potential = potential_creases(mesh).with_any_of(between)
    creases, hurry = yield from _shown(potential, mesh, observing(mesh, settings), settings, ChunkRunner())
    return creases & between, hurry


def _shown(
    potential: PotentialCreases, mesh: TriangleMesh, observe: Observe, settings: Settings, runner: ChunkRunner
) -> Steps[tuple[Booleans, bool]]:
    """The edges, (E,), that patches over potential creases show to be creases, and whether `FINISH` was sent.

    Then there are none.
    """
    wanted, none = _nodes_beside(mesh, potential.edges), np.zeros(len(mesh.edges), dtype=bool)
    wanted &= ~mesh.passed_through[mesh.node_vertex]
    if not wanted.any():
        return none, False
    steep = potential.edges & potential.steep
    decided = _confirmed(potential, steep, steep)
    if (decided == potential.edges).all():  # a fit could only say the same
        return _completed(mesh, potential.dihedral, decided), False
    patches = build_patches(mesh, build_cover(mesh, settings.ring, wanted), settings.ring, wanted, runner.each)
    look = replace(settings, iterations=min(LOOK, settings.iterations), keep_iterations=False)
    surface = PatchedSurface(mesh, *with_domains(mesh, patches, settings, runner.each), observe, look, runner)
    if (yield from surface.fit()):
        return none, True
    surface.forget_observations()
    representation = surface.representation()
    turn = turn_at_edges(representation, mesh, potential.edges, runner.each)
    seeds = potential.edges & (turn >= SEED_DEGREES)
    seeds &= edge_stretch(representation, mesh, seeds, runner.each) >= CREASE_STRETCH
    strong = seeds & (turn >= CREASE_DEGREES)
    return _completed(mesh, potential.dihedral, _confirmed(potential, seeds | steep, strong | steep)), False


def _nodes_beside(mesh: TriangleMesh, edges: Booleans) -> Booleans:
    """Nodes of the triangles on both sides of some edges, (N,)."""
    nodes = np.zeros(mesh.node_count, dtype=bool)
    nodes[mesh.nodes[mesh.edge_triangles[edges]]] = True
    return nodes


def _confirmed(potential: PotentialCreases, seeds: Booleans, strong: Booleans) -> Booleans:
    """Edges of the chains for which enough of their edges speak, (E,)."""
    chain, count = potential.chain[potential.edges], int(potential.chain.max()) + 1
    total, spoken, loud = (
        np.bincount(chain, weights=which[potential.edges], minlength=count)
        for which in (potential.edges, seeds, strong)
    )
    good = (spoken >= SEEDS * total) & (loud >= STRONG_SEEDS)
    confirmed = np.zeros(len(seeds), dtype=bool)
    confirmed[potential.edges] = good[chain]
    return confirmed


def _completed(mesh: TriangleMesh, dihedral: Array, creases: Booleans) -> Booleans:
    """Add the edges that bend as much and join creases beside a crease, and take short loose ends off.

    Contrast misses edges that have creases on all sides, such as those around the triangle at a bevelled corner.
    """
    bends = (dihedral >= CREASE_DEGREES) & mesh.named_by_vertices
    creases = creases.copy()
    for _ in range(ROUNDS):
        on = np.zeros(mesh.node_count, dtype=bool)
        on[mesh.edges[creases]] = True
        has = any_of(creases[mesh.triangle_edges] & (mesh.triangle_edges >= 0))
        joins = bends & ~creases & folded(np.logical_and, on[mesh.edges]) & any_of(has[mesh.edge_triangles])
        if not joins.any():
            break
        creases |= joins
    return _without_loose_ends(mesh, creases)


def _without_loose_ends(mesh: TriangleMesh, creases: Booleans) -> Booleans:
    """Take off ends of fewer than `SHORTEST_END` edges that hang on a junction."""
    kept = creases.copy()
    numbers = np.flatnonzero(creases)
    ends = mesh.edges[numbers].ravel()
    degree = np.bincount(ends, minlength=mesh.node_count)
    # the edges at each node, one node after the other
    edges_at, first = numbers[stable_order(ends) // 2], offsets_of(degree)
    for tip in np.flatnonzero((degree == 1) & ~mesh.border):
        node, path = int(tip), [edges_at[first[tip]]]
        while True:
            node = int(mesh.edges[path[-1]].sum()) - node
            if degree[node] != 2 or len(path) == SHORTEST_END:
                break
            path.append(next(edge for edge in edges_at[first[node] : first[node + 1]] if edge != path[-1]))
        if degree[node] > 2 and len(path) < SHORTEST_END:
            kept[path] = False
    return kept

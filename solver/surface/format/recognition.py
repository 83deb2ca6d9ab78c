"""What a file need not hold: recognised in the arrays of a representation before it is written.

Nodes, centres and rings, levels.  Whatever is recognised wrongly does not matter: it is compared with the arrays, and
exceptions are stored.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Array, Booleans, Indices
from ...mesh.edges import connected_parts
from .cover import HIDING, POWER, Cover, Incidence, ring_members

CANDIDATES = 3
"""Vertices of a patch that are tried as its centre."""


def nodes_of(
    triangles: Indices,
    count: int,
    mesh_triangles: Indices,
    corners: Indices,
    entries: int,
    fans: Indices | None = None,
) -> Indices:
    """Return the node of each corner of the mesh's triangles, (T, 3).

    A vertex through which the mesh is cut has several nodes: corners are one node when they are one vertex of a patch.

    Parameters
    ----------
    triangles, count
        Triangles (T, 3) of `count` vertices.
    mesh_triangles, corners, entries
        Mesh triangle of each patch triangle (S,), its corners as patch vertices (S, 3), and their number, M.
    fans
        Nodes between creases, (T, 3), which are taken where no patch vertex lies at two of them; None without creases.
    """
    if fans is not None:
        own = fans[mesh_triangles]
        met = np.full(entries, -1)
        met[corners] = own
        if (met[corners] == own).all():
            return renumbered(fans, triangles, count)
    flat = (3 * mesh_triangles[:, None] + np.arange(3)).ravel()
    size = triangles.size
    _, part = connected_parts(flat, size + corners.ravel(), size + entries)
    held = np.zeros(size, dtype=bool)
    held[flat] = True
    nodes = triangles.ravel().copy()
    parts, first = np.unique(part[:size][held], return_index=True)
    place = np.flatnonzero(held)[first]
    vertex = nodes[place]
    order = np.lexsort((place, vertex))
    extra = np.ones(len(parts), dtype=bool)
    extra[order[np.unique(vertex[order], return_index=True)[1]]] = False
    number = vertex.copy()
    number[extra] = count + np.arange(extra.sum())
    nodes[held] = number[np.searchsorted(parts, part[:size][held])]
    return nodes.reshape(-1, 3)


def renumbered(nodes: Indices, triangles: Indices, count: int) -> Indices:
    """Number nodes, (T, 3), by themselves: of the nodes of a vertex the one whose corner comes first has its number.

    The others go on from `count`, in the order of their vertices and first corners.
    """
    flat, vertex = nodes.ravel(), triangles.ravel()
    parts, first, part = np.unique(flat, return_index=True, return_inverse=True)
    own = np.full(count, -1)
    order = np.argsort(first, kind="stable")[::-1]
    own[vertex[first[order]]] = order  # the last one to be written is the first
    number = vertex[first]
    extra = np.flatnonzero(own[number] != np.arange(len(parts)))
    number[extra[np.lexsort((first[extra], number[extra]))]] = count + np.arange(len(extra))
    return number[part.ravel()].reshape(-1, 3)


def rings_of(cover: Cover, incidence: Incidence) -> tuple[Indices, Indices]:
    """Return the node at the centre of each patch and the radius of its ring, (K,) both; -1 and 0 where there is none.

    The ring lies inside of the patch; the patch may hold more.
    """
    count = len(cover.vertex_offsets) - 1
    found, radius = np.full(count, -1), np.zeros(count, dtype=np.int64)
    for place, rings in _candidates(cover, cover.rim(incidence)):
        patch = cover.patch_of_vertex[place]
        rows = found[patch] < 0
        patch, place, rings = patch[rows], place[rows], rings[rows]
        good = _inside(cover, incidence, patch, cover.nodes[place], rings)
        found[patch[good]], radius[patch[good]] = cover.nodes[place[good]], rings[good]
    return found, radius


def _candidates(cover: Cover, rim: Booleans) -> list[tuple[Indices, Indices]]:
    """Return vertices that may be centres, the first of each patch, then the second ..., and their rings.

    The centre of a ring is as far from one vertex of its rim as from another.
    """
    patch = cover.patch_of_vertex
    depth = cover.hops(rim)
    alike, nearest = depth > 0, np.full(len(patch), np.iinfo(np.int64).max)
    for _ in range(3):
        farthest = np.lexsort((np.arange(len(patch)), -nearest, ~rim, patch))[cover.vertex_offsets[:-1]]
        start = np.zeros(len(patch), dtype=bool)
        start[farthest[rim[farthest]]] = True
        away = cover.hops(start)
        alike &= away == depth
        nearest = np.minimum(nearest, np.where(away < 0, nearest, away))
    places = np.flatnonzero(alike)
    rank = np.arange(len(places)) - np.searchsorted(patch[places], patch[places])
    return [(places[rank == k], depth[places[rank == k]]) for k in range(CANDIDATES)]


def _inside(cover: Cover, incidence: Incidence, patch: Indices, centres: Indices, rings: Indices) -> Booleans:
    """Tell which rings have no triangle outside of their patches."""
    members = ring_members(incidence, centres, rings, np.iinfo(np.int64).max)
    count = np.int64(len(incidence.nodes))
    ring_keys = np.repeat(patch, np.diff(members.indptr)) * count + members.indices
    own = np.repeat(np.arange(len(cover.triangle_offsets) - 1), np.diff(cover.triangle_offsets))
    outside = ~np.isin(ring_keys, own * count + cover.mesh_triangles)
    row = np.repeat(np.arange(len(patch)), np.diff(members.indptr))
    good: Booleans = np.bincount(row, weights=outside, minlength=len(patch)) == 0
    return good


def levels_of(cover: Cover, vertices: Indices, depth: Indices, weights: Array) -> Indices:
    """Return the level of each patch, (K,), such that weights become as they are: finer patches hide coarser ones."""
    patch = cover.patch_of_vertex
    levels = np.zeros(len(cover.vertex_offsets) - 1, dtype=np.int64)
    some = np.flatnonzero((weights > 0.0) & (depth > 0))
    if not len(some):
        return levels
    height = np.log(weights[some] / depth[some] ** POWER) / np.log(HIDING)
    top = np.full(vertices.max() + 1, -np.inf)
    np.maximum.at(top, vertices[some], height)
    below = np.rint(height - top[vertices[some]]).astype(np.int64)
    for _ in range(len(levels)):
        highest = np.zeros(len(top), dtype=np.int64)
        np.maximum.at(highest, vertices[some], levels[patch[some]] - below)
        raised = levels.copy()
        np.maximum.at(raised, patch[some], highest[vertices[some]] + below)
        if (raised == levels).all():
            break
        levels = raised
    return levels

"""Sharp features that the optimisation found, and how sharp they are.

The patches are smooth functions; they turn sharply at a crease because the optimisation stretches the domain across
it, which lets a polynomial bend within one row of triangles.  So creases can be read off: edges across which the domain
is stretched and the surface turns.  Where the surface is cut along them it turns at the edge itself.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Booleans, Indices, rows_at, runs_of_rows, slices_of, sum_of
from ..mesh.normals import angle_between, face_normals
from ..mesh.triangle_mesh import TriangleMesh
from ..processes.each import Each, all_done
from .representation import Representation

CREASE_DEGREES = 25.0
"""Least angle between the surface's normals at the centroids on both sides of a crease."""

AT_EDGE = (0.2, 0.5, 0.8)
"""Where along an edge its sharpness is measured."""

TRIANGLES_AT_ONCE, PLACES_AT_ONCE = 100_000, 20_000
"""Patch triangles and places of the surface that are looked at together: more would only take memory."""

CREASE_STRETCH = 1.0
"""Least stretch of the domain across a crease, relative to that along it."""


def crease_edges(
    representation: Representation,
    mesh: TriangleMesh,
    degrees: float = CREASE_DEGREES,
    stretch: float = CREASE_STRETCH,
    each: Each = map,
) -> Indices:
    """Edges that the optimisation treats as creases.

    Parameters
    ----------
    representation
        The surface.
    mesh
        The mesh under it.
    degrees
        Least angle between the surface's normals on both sides.
    stretch
        Least ratio of the domain transformation's stretch across the edge to that along it, on average of both sides.
    each
        Looks at parts of the surface, perhaps several at once.

    Returns
    -------
    ndarray
        Pairs of vertices, (E, 2), the smaller number first, sorted.
    """
    turned = turn_at_edges(representation, mesh, mesh.edge_triangles[:, 1] >= 0, each) >= degrees
    chosen = np.flatnonzero(turned & (edge_stretch(representation, mesh, turned, each) >= stretch))
    ends: Indices = np.unique(np.sort(mesh.node_vertex[mesh.edges[chosen]], axis=1), axis=0)
    return ends


def crease_report(representation: Representation, each: Each = map) -> dict[str, float]:
    """Count what the surface is cut along, and measure how sharp it is there.

    Returns
    -------
    dict
        `edges`, `vertices`, and `share_at_edge`: the angles between the surface's normals on both sides of the edges,
        at `AT_EDGE`, as a share of the input's dihedrals; one where there are no creases.
    """
    sides, triangles = representation.fans.sides, representation.triangles
    found = {"edges": len(sides), "vertices": len(np.unique(representation.creases))}
    if not len(sides):
        return {**found, "share_at_edge": 1.0}
    side = np.arange(sides.size)
    triangle, corner = np.divmod(sides.ravel(), 3)
    starts = triangles[triangle, corner].reshape(-1, 2)
    opposed = starts[:, 0] != starts[:, 1]
    flat = face_normals(representation.vertices, triangles)[triangle].reshape(-1, 2, 3)
    dihedral = _between(flat, opposed)
    inside = np.zeros((len(AT_EDGE), sides.size, 3))
    for own, share in zip(inside, AT_EDGE, strict=True):
        along = np.full(sides.shape, share)
        along[opposed, 1] = 1.0 - share
        own[side, corner], own[side, (corner + 1) % 3] = 1.0 - along.ravel(), along.ravel()
    normals = _normals(representation, np.tile(triangle, len(AT_EDGE)), inside.reshape(-1, 3), each)
    turned = np.zeros(len(sides))
    for own in normals.reshape(len(AT_EDGE), -1, 2, 3):
        turned += np.minimum(_between(own, opposed), dihedral) / len(AT_EDGE)
    total = float(dihedral.sum())
    return {**found, "share_at_edge": float(turned.sum()) / total if total > 0.0 else 1.0}


def _between(normals: Array, opposed: Booleans) -> Array:
    """Angles between the normals beside edges, (C, 2, 3), where triangles run along them `opposed` or alike."""
    other = normals[:, 1] * np.where(opposed, 1.0, -1.0)[:, None]
    angles: Array = angle_between(normals[:, 0], other)
    return angles


def edge_stretch(
    representation: Representation, mesh: TriangleMesh, edges: Booleans | None = None, each: Each = map
) -> Array:
    """How far the domain is stretched across edges, relative to along them, (E,); one where not asked.

    The geometric mean over the triangles on both sides, the patches weighted as they are blended, and the domains.

    Parameters
    ----------
    edges
        Edges that are asked for, (E,); all where None.
    each
        Looks at some patches, perhaps several parts at once.
    """
    asked = np.ones(len(mesh.edges), dtype=bool) if edges is None else edges
    total, weights = np.zeros(len(mesh.edges)), np.zeros(len(mesh.edges))
    table = representation.corners

    def look(run: tuple[int, int]) -> tuple[Indices, Array, Array]:
        """Edges of some patches' triangles, (n,), the triangles' weights there, and these times the logarithms."""
        rows = slice(*representation.triangle_offsets[list(run)])
        # the corners are in the order of the mesh triangle's
        edge = rows_at(mesh.triangle_edges, representation.mesh_triangles[rows]).T
        side, row = np.nonzero((edge >= 0) & asked[edge])
        corners = rows_at(table[rows], row)
        weight = sum_of(representation.weights[corners]) / 3.0
        turned = np.take_along_axis(corners, (side[:, None] + np.arange(3)) % 3, axis=1)
        logarithms = np.zeros(len(row))
        for start, domain in zip(representation.initial_domains, representation.domains, strict=True):
            logarithms += np.log(_stretch_across(_two_sides(start, turned), _two_sides(domain, turned)))
        count = len(representation.domains)
        return edge[side, row], count * weight, weight * logarithms

    for edge, weight, logarithms in each(look, runs_of_rows(representation.triangle_offsets, TRIANGLES_AT_ONCE)):
        np.add.at(total, edge, logarithms)
        np.add.at(weights, edge, weight)
    return np.exp(np.divide(total, weights, out=np.zeros_like(total), where=weights > 0.0))


def _two_sides(domain: Array, corners: Indices) -> tuple[Array, Array]:
    """The triangles' sides from corner 0 to 1 and from 1 to 2 in a domain, (2, S) each."""
    a, b, c = (rows_at(domain, corner).T for corner in corners.T)
    return b - a, c - b


def _stretch_across(sides: tuple[Array, Array], moved: tuple[Array, Array]) -> Array:
    """|J n| / |J t| for the first side t and n at right angles to it, within [1e-3, 1e3]; J takes `sides` to `moved`.

    With the next side s, n = (|t|^2 s - (s t) t) / (t x s), up to its sign.
    """
    (t, s), (moved_t, moved_s) = sides, moved
    square, along, area = t[0] ** 2 + t[1] ** 2, s[0] * t[0] + s[1] * t[1], t[0] * s[1] - t[1] * s[0]
    sideways = np.hypot(square * moved_s[0] - along * moved_t[0], square * moved_s[1] - along * moved_t[1])
    forward = np.abs(area) * np.hypot(*moved_t)
    # a triangle without area is not stretched
    ratio = np.divide(sideways, forward, out=np.ones_like(forward), where=forward > 0.0)
    return np.clip(ratio, 1e-3, 1e3)


def turn_at_edges(representation: Representation, mesh: TriangleMesh, edges: Booleans, each: Each = map) -> Array:
    """Angle between the surface's normals at the centroids of an edge's triangles, (E,), degrees; 0 where not asked."""
    sides = mesh.edge_triangles[edges]
    beside = np.zeros(len(mesh.triangles), dtype=bool)
    beside[sides] = True
    asked = np.flatnonzero(beside)
    normals = np.zeros((len(mesh.triangles), 3))
    normals[asked] = _normals(representation, asked, np.full((len(asked), 3), 1.0 / 3.0), each)
    normals *= np.where(mesh.winding < 0, -1.0, 1.0)[:, None]
    turn = np.zeros(len(edges))
    turn[edges] = np.degrees(angle_between(normals[sides[:, 0]], normals[sides[:, 1]]))
    return turn


def _normals(representation: Representation, face: Indices, inside: Array, each: Each) -> Array:
    """Normals of the surface, (N, 3), at places in triangles (N,) with barycentric coordinates (N, 3)."""
    normals = np.empty((len(face), 3))

    def fill(part: slice) -> None:
        normals[part] = representation.normals(face[part], inside[part])

    representation.prepare(each)
    all_done(each, fill, slices_of(len(face), PLACES_AT_ONCE))
    return normals

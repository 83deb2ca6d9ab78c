"""Sharp features that the optimisation found, and how sharp they are.

The patches are smooth functions; they turn sharply at a crease because the optimisation stretches the domain across
it, which lets a polynomial bend within one row of triangles.  So creases can be read off: edges across which the domain
is stretched and the surface turns.  Where the surface is cut along them it turns at the edge itself.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Booleans, Indices, sum_of
from ..fitting.domain_energy import DomainEnergy
from ..mesh.normals import angle_between, face_normals
from ..mesh.triangle_mesh import TriangleMesh
from .representation import Representation

CREASE_DEGREES = 25.0
"""Least angle between the surface's normals at the centroids on both sides of a crease."""

AT_EDGE = (0.2, 0.5, 0.8)
"""Where along an edge its sharpness is measured."""

CREASE_STRETCH = 1.0
"""Least stretch of the domain across a crease, relative to that along it."""


def crease_edges(
    representation: Representation,
    mesh: TriangleMesh,
    degrees: float = CREASE_DEGREES,
    stretch: float = CREASE_STRETCH,
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

    Returns
    -------
    ndarray
        Pairs of vertices, (E, 2), the smaller number first, sorted.
    """
    turn = turn_at_edges(representation, mesh, mesh.edge_triangles[:, 1] >= 0)
    chosen = np.flatnonzero((turn >= degrees) & (edge_stretch(representation, mesh) >= stretch))
    ends: Indices = np.unique(np.sort(mesh.node_vertex[mesh.edges[chosen]], axis=1), axis=0)
    return ends


def crease_report(representation: Representation) -> dict[str, float]:
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
    each = np.arange(sides.size)
    triangle, corner = np.divmod(sides.ravel(), 3)
    starts = triangles[triangle, corner].reshape(-1, 2)
    opposed = starts[:, 0] != starts[:, 1]
    flat = face_normals(representation.vertices, triangles)[triangle].reshape(-1, 2, 3)
    dihedral = _between(flat, opposed)
    turned = np.zeros(len(sides))
    for share in AT_EDGE:
        inside = np.zeros((sides.size, 3))
        along = np.full(sides.shape, share)
        along[opposed, 1] = 1.0 - share
        inside[each, corner], inside[each, (corner + 1) % 3] = 1.0 - along.ravel(), along.ravel()
        normals = representation.normals(triangle, inside).reshape(-1, 2, 3)
        turned += np.minimum(_between(normals, opposed), dihedral) / len(AT_EDGE)
    total = float(dihedral.sum())
    return {**found, "share_at_edge": float(turned.sum()) / total if total > 0.0 else 1.0}


def _between(normals: Array, opposed: Booleans) -> Array:
    """Angles between the normals beside edges, (C, 2, 3), where triangles run along them `opposed` or alike."""
    other = normals[:, 1] * np.where(opposed, 1.0, -1.0)[:, None]
    angles: Array = angle_between(normals[:, 0], other)
    return angles


def edge_stretch(representation: Representation, mesh: TriangleMesh) -> Array:
    """How far the domain is stretched across each edge, relative to along it, (E,).

    The geometric mean over the triangles on both sides, the patches weighted as they are blended, and the domains.
    """
    corners = representation.corners
    names = representation.patch_vertices[corners]
    triangle = representation.mesh_triangles
    weight = sum_of(representation.weights[corners]) / 3.0
    total, weights = np.zeros(len(mesh.edges)), np.zeros(len(mesh.edges))
    for start, domain in zip(representation.initial_domains, representation.domains, strict=True):
        jacobian = DomainEnergy.of(start.T, corners).jacobian(domain.T)
        for side in range(3):
            along = start[corners[:, (side + 1) % 3]] - start[corners[:, side]]
            ratio = _stretch_across(jacobian, along.T)
            # a patch may have turned the triangle: the edge is the one opposite to the same vertex
            opposite = names[:, (side + 2) % 3]
            place = (mesh.triangles[triangle] == opposite[:, None]).argmax(axis=1)
            edge = mesh.triangle_edges[triangle, (place + 1) % 3]
            known = edge >= 0
            np.add.at(total, edge[known], (weight * np.log(ratio))[known])
            np.add.at(weights, edge[known], weight[known])
    return np.exp(np.divide(total, weights, out=np.zeros_like(total), where=weights > 0.0))


def _stretch_across(jacobian: Array, along: Array) -> Array:
    """|J n| / |J t| for the directions t = `along` (2, S) and n at right angles to it, within [1e-3, 1e3]."""
    forward = np.einsum("abs,bs->as", jacobian, along)
    sideways = np.einsum("abs,bs->as", jacobian, np.stack([-along[1], along[0]]))
    lengths = np.linalg.norm(sideways, axis=0), np.linalg.norm(forward, axis=0)
    ratio = np.divide(lengths[0], lengths[1], out=np.ones_like(lengths[0]), where=lengths[1] > 0.0)
    return np.clip(ratio, 1e-3, 1e3)


def turn_at_edges(representation: Representation, mesh: TriangleMesh, edges: Booleans) -> Array:
    """Angle between the surface's normals at the centroids of an edge's triangles, (E,), degrees; 0 where not asked."""
    sides = mesh.edge_triangles[edges]
    asked = np.unique(sides)
    normals = np.zeros((len(mesh.triangles), 3))
    normals[asked] = representation.normals(asked, np.full((len(asked), 3), 1.0 / 3.0))
    normals *= np.where(mesh.winding < 0, -1.0, 1.0)[:, None]
    turn = np.zeros(len(edges))
    turn[edges] = np.degrees(angle_between(normals[sides[:, 0]], normals[sides[:, 1]]))
    return turn

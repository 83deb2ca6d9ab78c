"""Sharp features that the optimisation found.

The patches are smooth functions; they turn sharply at a crease because the optimisation stretches the domain across
it, which lets a polynomial bend within one row of triangles.  No detection goes into the fit; afterwards the creases
can be read off: edges across which the domain is stretched and the surface turns.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices
from ..fitting.domain_energy import DomainEnergy
from ..mesh.normals import angle_between
from ..mesh.triangle_mesh import TriangleMesh
from .representation import Representation

CREASE_DEGREES = 25.0
"""Least angle between the surface's normals at the centroids on both sides of a crease."""

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
    sides = mesh.edge_triangles
    inside = np.flatnonzero((sides >= 0).all(axis=1))
    across = edge_stretch(representation, mesh)[inside]
    turn = _turn(representation, mesh, sides[inside])
    chosen = inside[(turn >= degrees) & (across >= stretch)]
    ends: Indices = np.unique(np.sort(mesh.node_vertex[mesh.edges[chosen]], axis=1), axis=0)
    return ends


def edge_stretch(representation: Representation, mesh: TriangleMesh) -> Array:
    """How far the domain is stretched across each edge, relative to along it, (E,).

    The geometric mean over the triangles on both sides, the patches weighted as they are blended, and the domains.
    """
    corners = representation.corners
    names = representation.patch_vertices[corners]
    triangle = representation.mesh_triangles
    weight = representation.weights[corners].mean(axis=1)
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


def _turn(representation: Representation, mesh: TriangleMesh, sides: Indices) -> Array:
    """Angle between the surface's normals at the centroids of two triangles (E, 2), degrees."""
    asked = np.unique(sides)
    normals = np.zeros((len(mesh.triangles), 3))
    normals[asked] = representation.normals(asked, np.full((len(asked), 3), 1.0 / 3.0))
    normals *= np.where(mesh.winding < 0, -1.0, 1.0)[:, None]
    one, other = normals[sides[:, 0]], normals[sides[:, 1]]
    return np.degrees(angle_between(one, other))

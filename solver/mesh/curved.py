"""A smooth surface beside a mesh: what its triangles stand for where they approximate a curved shape.

Over each triangle with corners v_i and unit normals n_i there lies the quadratic surface

    sum_i b_i v_i + sum_(i < j) b_i b_j c_ij,   c_ij = -1/2 ((v_j - v_i) . n_i  n_i + (v_i - v_j) . n_j  n_j),

b the barycentric coordinates: Phong tessellation (Boubekeur, Alexa 2008) with weight 1/2, which is exact for quadratic
functions.  It bulges over the triangle; so that it lies as often inside the mesh as outside, each node then moves along
its normal by the mean bulge of its triangles.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Booleans, Indices
from .normals import normals_and_areas, unit
from .triangle_mesh import TriangleMesh

STEEPEST = 30.0
"""Triangles whose corner normals are farther from their own than this, in degrees, stay flat: no curved shape says what
they stand for."""


def node_normals(mesh: TriangleMesh) -> Array:
    """Unit normals of the nodes, (N, 3), all wound alike.

    A triangle with sides e, f at a node and the angle a between them has the weight sin a / (|e| |f|), with which the
    normals of any polyhedron in a sphere are the sphere's (Max 1999).
    """
    normals, areas = normals_and_areas(mesh.vertices, mesh.triangles)
    normals *= np.where(mesh.winding < 0, -1.0, 1.0)[:, None]
    ahead = _sides(mesh)
    weights = _weights(ahead, areas)
    return unit(_around(mesh.nodes, weights[:, :, None] * normals[:, None], mesh.node_count))


def corrected_normals(mesh: TriangleMesh, around: Array, share: Array) -> Array:
    """Correct the normals of the nodes, (N, 3), by those of the curved surface that follows from them.

    Where the normals are those of a quadratic function, so is that surface, and nothing changes.  Otherwise its normals
    at a node differ from triangle to triangle, and their mean is closer to the shape's than the first normals are.  In
    noise it is not.

    Parameters
    ----------
    mesh, around
        Mesh and normals of its nodes, as `node_normals` returns them.
    share
        How much of the correction is made at each node, from 0 to 1, (N,).
    """
    normals, areas = normals_and_areas(mesh.vertices, mesh.triangles)
    normals *= np.where(mesh.winding < 0, -1.0, 1.0)[:, None]
    ahead, start = _sides(mesh), around[mesh.nodes]
    bulges = _bulges(ahead, start) * _tame(start, normals)[:, None, None]
    own = np.cross(ahead + bulges, np.roll(bulges - ahead, 1, axis=1))
    length = np.linalg.norm(own, axis=2) * np.where(mesh.winding < 0, -1.0, 1.0)[:, None]
    scaled = np.divide(_weights(ahead, areas), length, out=np.zeros_like(length), where=length != 0.0)
    found = unit(_around(mesh.nodes, scaled[:, :, None] * own, mesh.node_count))
    return unit(around + share[:, None] * (found - around))


def curved_offsets(mesh: TriangleMesh) -> tuple[Array, Array]:
    """Compute what leads from a mesh to the smooth surface beside it.

    Returns
    -------
    tuple
        Moves of the nodes, (N, 3), and c of each triangle's sides, (T, 3, 3); side k leads from corner k to k + 1.
    """
    normals, areas = normals_and_areas(mesh.vertices, mesh.triangles)
    normals *= np.where(mesh.winding < 0, -1.0, 1.0)[:, None]
    ahead = _sides(mesh)
    around = node_normals(mesh)
    start = around[mesh.nodes]
    bulges = _bulges(ahead, start) * _tame(start, normals)[:, None, None]
    # the mean of b_i b_j over a triangle is 1/12
    mean = areas[:, None] * np.einsum("tkd,tjd->tk", start, bulges) / 12.0
    along, area = (_around(mesh.nodes, own[:, :, None], mesh.node_count) for own in (mean, areas[:, None].repeat(3, 1)))
    return -np.divide(along, area, out=np.zeros_like(along), where=area > 0.0) * around, bulges


def offsets_inside(nodes: Indices, moves: Array, bulges: Array, samples: Array) -> Array:
    """From places in triangles to the smooth surface beside them, (T, q, 3).

    Parameters
    ----------
    nodes, moves, bulges
        Nodes of the triangles' corners, (T, 3), and what `curved_offsets` returns.
    samples
        Barycentric coordinates of the places, (q, 3).
    """
    between = samples * np.roll(samples, -1, axis=1)
    inside: Array = np.einsum("qk,tkd->tqd", samples, moves[nodes]) + np.einsum("qk,tkd->tqd", between, bulges)
    return inside


def _sides(mesh: TriangleMesh) -> Array:
    """Sides of the triangles from each corner to the next, (T, 3, 3)."""
    corners = mesh.vertices[mesh.triangles]
    ahead: Array = np.roll(corners, -1, axis=1) - corners
    return ahead


def _weights(ahead: Array, areas: Array) -> Array:
    """Half of sin a / (|e| |f|) at corners, (T, 3), of triangles with sides (T, 3, 3); 0 where a side has no length."""
    square = (ahead**2).sum(axis=2)
    product = square * np.roll(square, 1, axis=1)
    return np.asarray(np.divide(areas[:, None], product, out=np.zeros_like(product), where=product > 0.0))


def _bulges(ahead: Array, start: Array) -> Array:
    """C of each side, (T, 3, 3), from the sides and the normals at their starts, both (T, 3, 3)."""
    end = np.roll(start, -1, axis=1)
    at_start, at_end = (np.einsum("tkd,tkd->tk", ahead, own)[:, :, None] for own in (start, end))
    bulges: Array = 0.5 * (at_end * end - at_start * start)
    return bulges


def _tame(start: Array, normals: Array) -> Booleans:
    """Triangles, (T,), whose normals at the corners, (T, 3, 3), are at most STEEPEST off their own, (T, 3)."""
    least = (start @ normals[:, :, None])[:, :, 0].min(axis=1)
    return np.asarray(least >= np.cos(np.radians(STEEPEST)))


def _around(nodes: Indices, values: Array, count: int) -> Array:
    """Sum values of corners, (T, 3, d), at their nodes, (N, d)."""
    flat = values.reshape(nodes.size, -1)
    return np.stack([np.bincount(nodes.ravel(), column, count) for column in flat.T], axis=1)

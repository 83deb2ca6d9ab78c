"""A smooth surface beside a mesh: what its triangles stand for where they approximate a curved shape.

Over each triangle with corners v_i and unit normals n_i there lies the quadratic surface

    sum_i b_i v_i + sum_(i < j) b_i b_j c_ij,   c_ij = -1/2 ((v_j - v_i) . n_i  n_i + (v_i - v_j) . n_j  n_j),

b the barycentric coordinates: Phong tessellation (Boubekeur, Alexa 2008) with weight 1/2, which is exact for quadratic
functions.  It bulges over the triangle; so that it lies as often inside the mesh as outside, each node then moves along
its normal by the mean bulge of its triangles.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices
from .normals import angle_between, normals_and_areas, unit
from .triangle_mesh import TriangleMesh

STEEPEST = 30.0
"""Triangles whose corner normals are farther from their own than this, in degrees, stay flat: no curved shape says what
they stand for."""


def node_normals(mesh: TriangleMesh) -> Array:
    """Unit normals of the nodes, (N, 3), those of their triangles weighted by the angles there; all wound alike."""
    normals, _ = normals_and_areas(mesh.vertices, mesh.triangles)
    normals *= np.where(mesh.winding < 0, -1.0, 1.0)[:, None]
    corners = mesh.vertices[mesh.triangles]
    ahead = np.roll(corners, -1, axis=1) - corners
    angles = angle_between(ahead.reshape(-1, 3), -np.roll(ahead, 1, axis=1).reshape(-1, 3)).reshape(-1, 3)
    return unit(_around(mesh.nodes, angles[:, :, None] * normals[:, None], mesh.node_count))


def curved_offsets(mesh: TriangleMesh) -> tuple[Array, Array]:
    """Compute what leads from a mesh to the smooth surface beside it.

    Returns
    -------
    tuple
        Moves of the nodes, (N, 3), and c of each triangle's sides, (T, 3, 3); side k leads from corner k to k + 1.
    """
    normals, areas = normals_and_areas(mesh.vertices, mesh.triangles)
    normals *= np.where(mesh.winding < 0, -1.0, 1.0)[:, None]
    corners = mesh.vertices[mesh.triangles]
    ahead = np.roll(corners, -1, axis=1) - corners
    around = node_normals(mesh)
    start = around[mesh.nodes]
    end = np.roll(start, -1, axis=1)
    tame = (start @ normals[:, :, None])[:, :, 0].min(axis=1) >= np.cos(np.radians(STEEPEST))
    at_start, at_end = (np.einsum("tkd,tkd->tk", ahead, own)[:, :, None] for own in (start, end))
    bulges = 0.5 * (at_end * end - at_start * start) * tame[:, None, None]
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


def _around(nodes: Indices, values: Array, count: int) -> Array:
    """Sum values of corners, (T, 3, d), at their nodes, (N, d)."""
    flat = values.reshape(nodes.size, -1)
    return np.stack([np.bincount(nodes.ravel(), column, count) for column in flat.T], axis=1)

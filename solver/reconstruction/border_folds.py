"""Corners where a fold of an open cloud ends at its border: a base without a vertex there cuts the corner off."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array, Indices
from ..mesh.normals import face_normals
from ..mesh.triangle_mesh import TriangleMesh
from .base import LEAST_TURN, checked_base
from .geometry import SHARPEST, CloudGeometry
from .shell import border_edges

SPACINGS_OFF = 0.25
"""The middle of a border's edge crosses a fold where it is farther than this from the planes at both its ends."""

PULL = 1e-3
"""How much the middle of the edge counts beside the planes at its ends: it says where along the fold the corner is."""


def split_over_folds(mesh: TriangleMesh, points: Array, geometry: CloudGeometry) -> TriangleMesh:
    """Split the edges of a base's border that run across a fold of the cloud (P, 3), and move their middles onto it.

    The new vertex goes to where the tangent planes at both ends meet, nearest to the middle of the edge.
    """
    edges = border_edges(mesh.triangles, len(mesh.vertices))
    number = cKDTree(points).query(mesh.vertices[edges])[1]
    planes, on_planes = geometry.normals[number], points[number]
    middle = mesh.vertices[edges].mean(axis=1)
    height = (planes * (on_planes - middle[:, None])).sum(axis=2)
    across = np.abs((planes[:, 0] * planes[:, 1]).sum(axis=1)) < SHARPEST
    across &= np.abs(height).min(axis=1) > SPACINGS_OFF * geometry.spacing + geometry.noise
    if not across.any():
        return mesh
    planes, height = planes[across], height[across]
    matrix = np.matmul(planes.swapaxes(1, 2), planes) + PULL * np.eye(3)
    move = np.linalg.solve(matrix, (planes * height[:, :, None]).sum(axis=1)[:, :, None])[:, :, 0]
    result = mesh
    for edge, place in zip(edges[across], middle[across] + move, strict=True):
        result = _split(result, edge, place)
    return result


def _split(mesh: TriangleMesh, edge: Indices, place: Array) -> TriangleMesh:
    """Put a vertex into an edge of the border, unless its triangle would fold or the vertex lie far off."""
    triangle = int(np.flatnonzero(np.isin(mesh.triangles, edge).sum(axis=1) == 2)[0])
    corners = mesh.triangles[triangle]
    first = next(k for k in range(3) if corners[(k + 2) % 3] not in edge)
    one, other, tip = np.roll(corners, -first)
    vertices = np.concatenate([mesh.vertices, place[None]])
    halves = np.array([[one, len(mesh.vertices), tip], [len(mesh.vertices), other, tip]])
    turn = (face_normals(mesh.vertices, corners[None]) * face_normals(vertices, halves)).sum(axis=1)
    length = np.linalg.norm(np.subtract(*mesh.vertices[edge]))
    if (turn < LEAST_TURN).any() or (np.linalg.norm(mesh.vertices[edge] - place, axis=1) > length).any():
        return mesh
    return checked_base(vertices, np.concatenate([np.delete(mesh.triangles, triangle, axis=0), halves]))

"""Thin parts seen from both sides: given normals tell which layer a point belongs to, and where inside is.

Two layers closer together than their points are apart look like one noisy sheet.  Where normals of neighbours are
opposed, and these neighbours lie behind one another, they are two layers with the inside in between.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array, Indices
from ..mesh.normals import face_normals

NEIGHBOURS = 16
"""Points among which opposed ones are sought, the point itself included."""

OPPOSED, FEWEST = -0.5, 0.05
"""Cosine below which two normals are opposed, and the share of points that have such a neighbour at least."""

AGREEING = 0.9
"""Share of these neighbours that lie behind a point, or of a shell's triangles that face outwards, at least."""

APART = 3.0
"""Points with opposed normals are moved apart by twice this many spacings where neighbours are sought."""


def outward_normals(points: Array, normals: Array) -> Array | None:
    """Unit normals that point out of a cloud's thin parts; None where it has none, or the normals do not show them.

    Parameters
    ----------
    points, normals
        The cloud and what came with it, (P, 3); the normals of any length, all outwards or all inwards.
    """
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    unit = normals / np.where(length > 0.0, length, 1.0)
    near = cKDTree(points).query(points, k=min(NEIGHBOURS, len(points)))[1]
    opposed = (unit[near] * unit[:, None]).sum(axis=2) < OPPOSED
    if opposed.any(axis=1).mean() < FEWEST:
        return None
    height = ((points[near] - points[:, None]) * unit[:, None]).sum(axis=2)[opposed]
    behind = float((height < 0.0).mean())
    if max(behind, 1.0 - behind) < AGREEING:
        return None
    return unit if behind > 0.5 else -unit


def apart(points: Array, outward: Array | None, spacing: float) -> Array:
    """Coordinates in which layers lie apart, (P, 6), by the normals; without these the points themselves, (P, 3)."""
    return points if outward is None else np.concatenate([points, APART * spacing * outward], axis=1)


def faces_outward(vertices: Array, triangles: Indices, points: Array, outward: Array) -> bool:
    """Whether nearly all of a shell has points beside it that face the same way: none of it is a sheet's back."""
    corners = vertices[triangles]
    near = cKDTree(points).query(corners.mean(axis=1), k=min(NEIGHBOURS, len(points)))[1]
    normals = face_normals(vertices, triangles)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    agrees = ((outward[near] * normals[:, None]).sum(axis=2) > 0.0).any(axis=1)
    return bool(area[agrees].sum() > AGREEING * area.sum())

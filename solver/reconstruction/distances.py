"""How far points and reconstructed surface are from each other, both ways, and how the surface hangs together."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array
from ..mesh.edges import connected_parts, edge_keys
from ..mesh.sampling import triangle_grid
from ..surface.representation import Representation

MOST_SPLITS = 16
"""Finest grid on which a triangle of the base is compared with the points."""

SAMPLES_AT_ONCE = 500_000


def both_ways(representation: Representation, points: Array, distance: Array, spacing: float) -> dict[str, Any]:
    """Measure points against the surface, and the surface against the points.

    The surface is sampled as finely as the points, if the base is not too coarse for that.  Where there are no points,
    only the surface's distance from the nearest one shows how far it went.

    Parameters
    ----------
    points, distance
        The cloud, (P, 3), and each point's nearest distance from the surface, (P,).
    spacing
        Of the cloud; `rms_spacings` and `max_spacings` are in this unit.

    Returns
    -------
    dict
        `points_to_surface`, `surface_to_points`, `pieces` and `euler` of `Report`.
    """
    return {
        "points_to_surface": _summary(distance, spacing),
        "surface_to_points": _summary(surface_to_points(representation, points, spacing), spacing),
        **_topology(representation),
    }


def surface_to_points(representation: Representation, points: Array, spacing: float) -> Array:
    """Distance of samples of the surface from the nearest point, (T q,), scene units."""
    triangles = representation.triangles
    corners = representation.vertices[triangles]
    longest = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(initial=0.0))
    grid = triangle_grid(int(np.clip(np.ceil(longest / max(spacing, 1e-300)), 2, MOST_SPLITS)))
    tree, found = cKDTree(points), []
    for part in np.array_split(np.arange(len(triangles)), 1 + len(triangles) * len(grid) // SAMPLES_AT_ONCE):
        on_surface = representation.evaluate(np.repeat(part, len(grid)), np.tile(grid, (len(part), 1)))
        found.append(tree.query(on_surface)[0])
    return np.concatenate(found)


def _summary(distance: Array, spacing: float) -> dict[str, float]:
    rms, largest = float(np.sqrt(np.mean(distance**2))), float(distance.max(initial=0.0))
    unit = max(spacing, 1e-300)
    return {"rms": rms, "max": largest, "rms_spacings": rms / unit, "max_spacings": largest / unit}


def _topology(representation: Representation) -> dict[str, int]:
    """Connected parts, and Euler's characteristic V - E + F of what triangles use."""
    triangles = representation.triangles
    used, corners = np.unique(triangles, return_inverse=True)
    corners = corners.reshape(-1, 3)
    following = np.roll(corners, -1, axis=1)
    edges = len(np.unique(edge_keys(corners.ravel(), following.ravel(), len(used))))
    pieces, _ = connected_parts(corners.ravel(), following.ravel(), len(used))
    return {"pieces": int(pieces), "euler": len(used) - edges + len(triangles)}

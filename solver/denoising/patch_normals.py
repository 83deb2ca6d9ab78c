"""Normals of patches: those of the quadratics, and those of triangles whose corners lie on them."""

from __future__ import annotations

import numpy as np

from ..arrays import Array

_SLIM = 1e-2  # of a triangle's squared extent: across one that is slimmer, tangent planes say how it leans


def local_normals(at: Array, coefficients: Array, lengths: Array, bends: Array | None = None) -> Array:
    """Return the quadratics' unit normals at (u, v), (P, 2, N), in their own frames: (P, 3, N).

    With `bends`, (P, 2, N), the slopes along u and v are larger by these.
    """
    u, v = at[:, 0], at[:, 1]
    c = coefficients[..., None]
    slope_u = c[:, 1] + 2 * c[:, 3] * u
    slope_u += c[:, 4] * v
    slope_v = c[:, 2] + c[:, 4] * u
    slope_v += 2 * c[:, 5] * v
    normals = np.empty((len(at), 3, at.shape[2]))
    for axis, slope in enumerate((slope_u, slope_v)):
        if bends is not None:
            slope += bends[:, axis]
        slope /= lengths[:, None]
        np.multiply(slope, slope, out=normals[:, axis])
    upward = normals[:, 2]
    np.add(normals[:, 0], 1, out=upward)
    upward += normals[:, 1]
    np.divide(1, np.sqrt(upward, out=upward), out=upward)
    for axis, slope in enumerate((slope_u, slope_v)):
        np.multiply(np.negative(slope, out=slope), upward, out=normals[:, axis])
    return normals


def bends_of_triangles(corners: Array, coefficients: Array) -> Array:
    """Return by how much the planes through quadratics' points at corners are steeper than the tangent planes.

    A curved patch's normal at a triangle's centroid is not that of the triangle.  The plane is that of least squares;
    where a triangle is so slim that its corners say little about the slope across it, the tangent plane's is preferred.

    Parameters
    ----------
    corners
        From the centroids, in (u, v), (P, 2, 3, K).
    coefficients
        (P, 6).

    Returns
    -------
    Changes of the heights' slopes along u and v, (P, 2, K).
    """
    u, v = corners[:, 0], corners[:, 1]
    c = coefficients[..., None, None]
    heights = c[:, 3] * u * u + c[:, 4] * u * v + c[:, 5] * v * v
    along_u, along_v = (heights * u).sum(axis=1), (heights * v).sum(axis=1)
    uu, uv, vv = (u * u).sum(axis=1), (u * v).sum(axis=1), (v * v).sum(axis=1)
    narrow = 0.5 * (uu + vv - np.sqrt((uu - vv) ** 2 + 4 * uv * uv))
    held = np.maximum(_SLIM * (uu + vv) - narrow, 1e-300)
    uu, vv = uu + held, vv + held
    slopes = np.stack((vv * along_u - uv * along_v, uu * along_v - uv * along_u), axis=1)
    return slopes / np.maximum(uu * vv - uv * uv, 1e-300)[:, None]

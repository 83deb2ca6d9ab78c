"""The flat triangles under a surface: places on them, checked, and what they add to the surface where they show."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Indices, largest_of, rows_at, sum_of
from ..errors import InputError

SLACK = 1e-4
"""By how much barycentric coordinates may be off; single precision computes them to 1e-7."""


def checked_places(face_index: ArrayLike, barycentric: ArrayLike, triangles: int) -> tuple[Indices, Array]:
    """Return triangles (N,) and barycentric coordinates (N, 3) of places on a mesh of this many triangles.

    Raises
    ------
    InputError
        When a triangle does not exist or the arrays do not fit.
    """
    face, inside = np.asarray(face_index), np.asarray(barycentric, dtype=np.float64)
    if face.ndim != 1 or inside.shape != (len(face), 3):
        raise InputError("Evaluating needs N face numbers and an array of N x 3 barycentric coordinates.")
    if len(face) and (face.dtype.kind not in "iu" or face.min() < 0 or face.max() >= triangles):
        raise InputError(f"Face numbers must be whole numbers from 0 to {triangles - 1}.")
    # written so that NaN is refused too
    if len(face) and not (inside.min() >= -SLACK and abs(sum_of(inside) - 1.0).max() <= SLACK):
        raise InputError("Barycentric coordinates must be three numbers from 0 to 1 with the sum 1 for each point.")
    return face.astype(np.int64), inside


def flat_part(
    vertices: Array, triangles: Indices, weights: Array, face: Indices, inside: Array, tangents: bool
) -> Array:
    """Part w x of the flat triangles in a blend at N points x, (3, N), and with `tangents` of both tangents, (9, N).

    Parameters
    ----------
    vertices, triangles
        The mesh, (V, 3) and (T, 3).
    weights
        Its weight at the triangles' corners, (T, 3), linear between them.
    face, inside
        Triangles (N,) and barycentric coordinates (3, N).
    """
    sums = np.zeros((len(face), 9 if tangents else 3)).T
    shows = np.flatnonzero(largest_of(rows_at(weights, face)))
    if not len(shows):
        return sums
    corners = vertices[triangles[face[shows]]].transpose(1, 2, 0)
    own, inside = weights[face[shows]].T, inside[:, shows]
    flat = (inside[:, None] * corners).sum(axis=0)
    rest = (inside * own).sum(axis=0)
    parts = [rest * flat]
    for k in (1, 2) if tangents else ():
        parts.append((own[k] - own[0]) * flat + rest * (corners[k] - corners[0]))
    sums[:, shows] = np.concatenate(parts)
    return sums

"""Turning triangles back that noise along the surface has folded over, by moving vertices within the surface.

Noise along the normals never folds a triangle over its neighbour; noise along the surface does.  Where it did, no
movement along the normals helps: vertices have to move sideways.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from ..arrays import Array, Booleans, Indices
from ..mesh.normals import normals_and_areas
from .seeds import GOLDEN
from .surface import Surface
from .vertex_update import limited

_FOLDED_SHARE = 1e-3  # of the triangles must face against the surface
_CROOKED = np.cos(np.radians(20.0))  # between a triangle and the surface
_STIFFNESS = 3e-3  # of a vertex on its surface: on a crease of 20 degrees the weaker plane weighs ten times as much
_STEP = 0.5
_ROUNDS = 40


def folded_share(vertices: Array, surface: Surface, normals: Array) -> float:
    """Return the share of the triangles that face against their filtered normals, (T, 3)."""
    actual, _ = normals_and_areas(vertices, surface.triangles)
    return float(np.mean((actual * normals).sum(axis=1) < 0)) if len(normals) else 0.0


def repair_triangles(
    vertices: Array, moved: Array, matrices: Array, known: Booleans, surface: Surface, normals: Array, limit: float
) -> Array:
    """Move vertices sideways until the triangles around them lie in the surface; unchanged where few are folded.

    In each round some of the vertices of crooked triangles, no two of them neighbours, move towards the mean of their
    neighbours, as far as their planes let them: within the surface, along a crease, not at all in a corner.  A move
    counts only if it brings the triangles around closer to the filtered normals.  Borders stay.

    Parameters
    ----------
    vertices, moved
        Positions before and after denoising, (V, 3).
    matrices
        Mean of n n^T over each vertex's planes, (V, 3, 3).
    known
        Vertices that have planes, (V,).
    surface, normals
        The mesh and the filtered normals of its triangles, (T, 3).
    limit
        Longest way from a vertex's position before.
    """
    if folded_share(moved, surface, normals) < _FOLDED_SHARE:
        return moved
    triangles = surface.triangles
    around = _vertex_neighbours(triangles, len(vertices))
    valence = np.maximum(np.diff(around.indptr), 1)[:, None]
    freedom = _STIFFNESS * np.linalg.inv(matrices + _STIFFNESS * np.eye(3))
    may_move = known & ~surface.border
    result = moved.copy()
    for round_number in range(1, _ROUNDS + 1):
        misfit = _misfit(result, triangles, normals)
        crooked = np.zeros(len(vertices), dtype=bool)
        crooked[triangles[misfit > 1 - _CROOKED]] = True
        chosen = _independent(crooked & may_move, around, round_number)
        if not len(chosen):
            break
        aside = (around[chosen] @ result) / valence[chosen] - result[chosen]
        step = _STEP * np.einsum("vij,vj->vi", freedom[chosen], aside)
        trial = result.copy()
        trial[chosen] = vertices[chosen] + limited(result[chosen] + step - vertices[chosen], limit)
        better = _improved(trial, triangles, normals, misfit, chosen)
        result[better] = trial[better]
    return result


def _vertex_neighbours(triangles: Indices, count: int) -> csr_array:
    one = triangles[:, [0, 1, 1, 2, 2, 0]].ravel()
    two = triangles[:, [1, 0, 2, 1, 0, 2]].ravel()
    around = coo_array((np.ones(len(one)), (one, two)), shape=(count, count)).tocsr()
    around.data[:] = 1.0
    return csr_array(around)


def _misfit(vertices: Array, triangles: Indices, normals: Array) -> Array:
    """One minus the cosine of the angle between triangles and their filtered normals, (T,)."""
    actual, _ = normals_and_areas(vertices, triangles)
    misfit: NDArray[np.float64] = 1 - (actual * normals).sum(axis=1)
    return misfit


def _independent(candidates: Booleans, around: csr_array, round_number: int) -> Indices:
    """Return some of the candidates, no two of them neighbours, others in each round."""
    count = len(candidates)
    turn = np.where(candidates, np.arange(1, count + 1) * (round_number * GOLDEN) % 1.0, 2.0)
    first = np.full(count, 2.0)
    np.minimum.at(first, np.repeat(np.arange(count), np.diff(around.indptr)), turn[around.indices])
    return np.flatnonzero(candidates & (turn < first))


def _improved(trial: Array, triangles: Indices, normals: Array, misfit: Array, chosen: Indices) -> Indices:
    """Return the chosen vertices whose triangles fit better in the trial; each triangle has at most one of them."""
    is_chosen = np.zeros(len(trial), dtype=bool)
    is_chosen[chosen] = True
    corners = is_chosen[triangles]
    touched = np.flatnonzero(corners.any(axis=1))
    gain = misfit[touched] - _misfit(trial, triangles[touched], normals[touched])
    vertex = triangles[touched, corners[touched].argmax(axis=1)]
    return chosen[np.bincount(vertex, gain, len(trial))[chosen] > 0]

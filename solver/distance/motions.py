"""Small motions that bring points closest to their partners, as a linear problem."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..arrays import Array


def placing(linear: Array, origin: Array, goal: Array) -> Array:
    """Return the 4 x 4 matrix that takes `origin` to `goal` with this linear part."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, goal - linear @ origin
    return matrix


def moved_by(matrix: Array, points: Array) -> Array:
    """Return points (N, 3) moved by a 4 x 4 matrix."""
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def small_motion(points: Array, partners: Array, directions: Array, scaled: bool) -> Array:
    r"""Return the small motion, (4, 4), that brings points closest to their partners along given directions.

    Parameters
    ----------
    points, partners, directions
        (N, 3) each.  The length of a direction is its weight: one over what is to be expected of the distance.
    scaled
        Whether the motion may change the size.

    Notes
    -----
    It minimises :math:`\sum_i (d_i \cdot (p_i + r \times (p_i - m) + s (p_i - m) + t - q_i))^2` over the turn r, the
    shift t and the growth s, with points p, partners q, directions d, and the points' middle m.
    """
    middle = points.mean(axis=0)
    arms = points - middle
    reach = float(np.sqrt((arms**2).sum(axis=1).mean())) or 1.0
    columns = [np.cross(arms, directions) / reach, directions]
    if scaled:
        columns.append((arms * directions).sum(axis=1, keepdims=True) / reach)
    system = np.concatenate(columns, axis=1)
    missing = ((partners - points) * directions).sum(axis=1)
    square = system.T @ system
    square[np.diag_indices_from(square)] += 1e-9 * np.trace(square) / len(square)  # a ball may turn as it likes
    found = np.linalg.solve(square, system.T @ missing)
    turn = Rotation.from_rotvec(found[:3] / reach).as_matrix()
    size = max(0.5, min(2.0, 1.0 + found[6] / reach)) if scaled else 1.0
    return placing(size * turn, middle, middle + found[3:6])

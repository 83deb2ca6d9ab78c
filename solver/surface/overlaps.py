"""How well patches agree where they overlap, before blending (section 4.2, Fig. 9)."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from .representation import Representation


def overlap_gaps(representation: Representation) -> Array:
    """Gap between the patches at every input vertex.

    Parameters
    ----------
    representation
        The patches; their blending weights do not matter.

    Returns
    -------
    ndarray
        Largest distance between the points that two patches have for the same vertex, (V,), scene units; zero where
        fewer than two patches meet.
    """
    order = np.argsort(representation.patch_vertices, kind="stable")
    vertices, points = representation.patch_vertices[order], representation.at_patch_vertices[order]
    gaps = np.zeros(len(representation.vertices))
    # Entries of one vertex are neighbours now: compare each with the next one, the one after that, and so on.
    for distance in range(1, len(vertices)):
        pairs = np.flatnonzero(vertices[distance:] == vertices[:-distance])
        if not len(pairs):
            break
        gap = np.linalg.norm(points[pairs + distance] - points[pairs], axis=1)
        np.maximum.at(gaps, vertices[pairs], gap)
    return gaps

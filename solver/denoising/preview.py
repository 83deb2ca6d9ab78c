"""The mesh while its noise is being removed: vertices that no patch has reached yet follow the filtered normals."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..arrays import Array
from ..mesh.normals import normals_and_areas
from .patch_average import PatchAverage
from .surface import Surface
from .vertex_update import LARGEST_MOVE, follow_normals, move_wild_ones_far, update_directions

_FOLLOWING_STEPS = 3


class Preview:
    """Where the vertices are as long as more patches are being fitted; computed only when somebody looks.

    Parameters
    ----------
    surface, noisy
        The mesh; positions (V, 3).
    guide
        Filtered normals of the triangles, (T, 3).
    noise_level, known_level
        Standard deviation along the normals of the noise to be removed, and the largest plausible one.
    """

    def __init__(self, surface: Surface, noisy: Array, guide: Array, noise_level: float, known_level: float) -> None:
        self._surface, self._noisy, self._guide = surface, noisy, guide
        self._noise_level, self._known_level = noise_level, known_level

    def vertices(self, first: PatchAverage, *others: PatchAverage) -> Array:
        """Return the vertices, (V, 3), on the planes that the patches of these averages give together."""
        planes = first.planes_so_far(*others)
        levels = (self._noise_level, self._known_level)
        moved, _ = move_wild_ones_far(self._noisy, planes, self._directions, *levels)
        known = planes[2] > 0
        return moved if known.all() else np.where(known[:, None], moved, self._following)

    @cached_property
    def _directions(self) -> Array:
        _, areas = normals_and_areas(self._noisy, self._surface.triangles)
        return update_directions(self._guide, areas, self._surface, len(self._noisy))

    @cached_property
    def _following(self) -> Array:
        everywhere = np.ones(len(self._noisy), dtype=bool)
        limit = LARGEST_MOVE * self._noise_level
        return follow_normals(self._noisy, self._noisy, everywhere, self._surface, self._guide, limit, _FOLLOWING_STEPS)

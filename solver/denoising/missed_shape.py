"""Shape that patches have levelled out: what the residuals of neighbouring vertices have in common.

Noise of neighbouring vertices has nothing in common but what the patches themselves have left of it.  That part follows
from how they answer to signs drawn at random: Stein's unbiased estimate of the risk, its divergence after Hutchinson.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from ..arrays import Array, Indices
from .patch_average import PatchAverage
from .seeds import signs
from .surface import Surface
from .vertex_update import limited

_ROUNDS = (16, 8)  # of means over a vertex and its neighbours: as wide as patches of about 110 and 60 triangles
_FEWEST_VERTICES = 200  # on which an estimate rests, as that of the noise level


def bring_back(
    noisy: Array,
    moved: Array,
    directions: Array,
    surface: Surface,
    average: PatchAverage,
    noise_level: float,
    limit: float,
) -> Array:
    """Return the vertices with a share of what the residuals around have in common, where that is closer to the shape.

    The mean of the residuals around a vertex is shape that patches of some size have levelled out, and noise.  The
    share of it that minimises the expected squared error is estimated, for the heights and for the differences of
    neighbours' heights; the lesser counts, less a standard error.  Vertices whose patches are alike in size have one
    share: relief and wide sides of one mesh need others.

    Parameters
    ----------
    noisy, moved
        Positions before, and on their planes, (V, 3).
    directions
        Unit normals at the vertices, (V, 3).
    surface
        The mesh.
    average
        The patches.
    noise_level
        Standard deviation of the noise along the normals, which must be independent.
    limit
        Longest move.
    """
    known = average.planes()[2] > 0
    noise = np.where(known, signs(len(noisy)), 0.0)
    left = np.where(known, ((noisy - moved) * directions).sum(axis=1), 0.0)
    left_of_noise = np.where(known, noise - average.responses(), 0.0)
    neighbours, classes = _Neighbours(surface, len(noisy)), _classes(surface, average, len(noisy))
    change = np.zeros(len(noisy))
    for rounds in _ROUNDS:
        common, common_of_noise = (neighbours.smoothed(each, rounds) for each in (left, left_of_noise))
        # The rest is noise, and more of it than was estimated where that has wild vertices.
        rest = float(left @ (left - common)) / max(float(left_of_noise @ (left_of_noise - common_of_noise)), 1e-300)
        variance = max(noise_level**2, rest)
        shares = np.ones(len(classes))
        for measured in (_itself, neighbours.differences):
            evidence = left * measured(common) - variance * noise * measured(common_of_noise)
            # Of a quadratic form of noise, twice: that of the noise itself, and that of the signs.
            doubt = 4 * (variance * measured(neighbours.smoothed(noise, rounds))) ** 2
            shares = np.minimum(shares, _shares(classes, evidence, doubt, common * measured(common)))
        shares = neighbours.smoothed(shares, rounds) * known
        change += shares * common
        left, left_of_noise = left - shares * common, left_of_noise - shares * common_of_noise
    result = noisy + limited(moved + change[:, None] * directions - noisy, limit)
    return np.where((change == 0.0)[:, None], moved, result)


def _itself(values: Array) -> Array:
    return values


def _shares(classes: Indices, evidence: Array, doubt: Array, squares: Array) -> Array:
    """Return the share, (V,), in [0, 1], that each class of vertices is to have."""
    certain = np.bincount(classes, evidence) - np.sqrt(np.bincount(classes, doubt))
    shares = np.clip(certain / np.maximum(np.bincount(classes, squares), 1e-300), 0.0, 1.0)
    return np.where(np.bincount(classes) < _FEWEST_VERTICES, 0.0, shares)[classes]


def _classes(surface: Surface, average: PatchAverage, vertex_count: int) -> Indices:
    """Return which vertices have patches alike in size, (V,): numbers that count its doublings."""
    corners = surface.triangles.ravel()
    total = np.bincount(corners, np.repeat(average.patch_sizes, 3), vertex_count)
    sizes = total / np.maximum(np.bincount(corners, minlength=vertex_count), 1)
    return np.round(np.log2(np.maximum(sizes, 1.0))).astype(np.int64)


class _Neighbours:
    """Means over and differences from the vertices across edges."""

    def __init__(self, surface: Surface, vertex_count: int) -> None:
        one = surface.triangles.ravel()
        other = np.roll(surface.triangles, 1, axis=1).ravel()
        ends = np.concatenate((one, other)), np.concatenate((other, one))
        across = csr_array(coo_array((np.ones(2 * len(one)), ends), shape=(vertex_count, vertex_count)))
        across.data[:] = 1.0
        self._across, self._count = across, np.diff(across.indptr).astype(np.float64)

    def smoothed(self, values: Array, rounds: int) -> Array:
        """Return the values, (V,), after means of each with the mean of its neighbours, so many times."""
        for _ in range(rounds):
            values = 0.5 * (values + self._across @ values / np.maximum(self._count, 1.0))
        return values

    def differences(self, values: Array) -> Array:
        """Return the sum of the differences of each value, (V,), from those of its neighbours."""
        differences: Array = self._count * values - self._across @ values
        return differences

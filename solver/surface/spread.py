"""Statistics of distances that can be put together from those of parts."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..arrays import Array, Indices

BINS_PER_OCTAVE = 64
"""The 95th percentile is known to 1.1 %."""

OCTAVES = 200
"""Distances from 2^-100 to 2^100 are told apart."""


@dataclass(frozen=True, eq=False)
class Spread:
    """Number, sum, sum of squares, maximum and histogram of distances."""

    count: int = 0
    total: float = 0.0
    squares: float = 0.0
    largest: float = 0.0
    histogram: Indices = field(default_factory=lambda: np.zeros(BINS_PER_OCTAVE * OCTAVES + 1, dtype=np.int64))

    @classmethod
    def of(cls, distances: Array) -> Spread:
        """Measure distances, of any shape."""
        with np.errstate(divide="ignore"):
            octave = np.log2(distances.ravel()) + OCTAVES / 2
        bins = np.clip(np.ceil(octave * BINS_PER_OCTAVE), 0, BINS_PER_OCTAVE * OCTAVES).astype(np.int64)
        return cls(
            distances.size,
            float(distances.sum()),
            float((distances**2).sum()),
            float(distances.max(initial=0.0)),
            np.bincount(bins, minlength=BINS_PER_OCTAVE * OCTAVES + 1),
        )

    def __add__(self, other: Spread) -> Spread:
        """Return what is measured of both together."""
        return Spread(
            self.count + other.count,
            self.total + other.total,
            self.squares + other.squares,
            max(self.largest, other.largest),
            self.histogram + other.histogram,
        )

    def statistics(self) -> dict[str, float]:
        """Root mean square, mean, 95th percentile (rounded up to a bin) and maximum; zeros where there are none."""
        if not self.count:
            return {"rms": 0.0, "mean": 0.0, "p95": 0.0, "max": 0.0}
        place = int(np.searchsorted(np.cumsum(self.histogram), 0.95 * self.count))
        p95 = 2.0 ** (place / BINS_PER_OCTAVE - OCTAVES / 2) if place else 0.0
        return {
            "rms": float(np.sqrt(self.squares / self.count)),
            "mean": self.total / self.count,
            "p95": min(p95, self.largest),
            "max": self.largest,
        }

    def as_list(self) -> list[list[float]]:
        """Return plain values, for a file."""
        filled = np.flatnonzero(self.histogram)
        moments = [self.count, self.total, self.squares, self.largest]
        return [moments, filled.tolist(), self.histogram[filled].tolist()]

    @classmethod
    def from_list(cls, values: list[list[float]]) -> Spread:
        """Take what `as_list` returned."""
        (count, total, squares, largest), filled, counts = values
        found = cls(int(count), total, squares, largest)
        found.histogram[np.array(filled, dtype=np.int64)] = counts
        return found

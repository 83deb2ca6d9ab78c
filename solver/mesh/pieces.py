"""Connected pieces of a mesh and their sizes.

What is negligible, or far, is a share of a size.  It is that of the piece: a screw beside a house is treated as it
would be alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Indices, largest_of
from .edges import stable_order


@dataclass(frozen=True, eq=False)
class Pieces:
    """The connected pieces of V vertices.

    Attributes
    ----------
    piece
        Piece of each vertex, (V,).
    low, high
        Corners of their bounding boxes, (P, 3).
    """

    piece: Indices
    low: Array
    high: Array

    @classmethod
    def of(cls, points: Array, piece: Indices, count: int) -> Pieces:
        """Measure pieces of points (V, 3), none of them empty."""
        if count == 1:
            return cls(piece, points.min(axis=0)[None], points.max(axis=0)[None])
        order = stable_order(piece)
        starts = np.flatnonzero(np.diff(piece[order], prepend=-1))
        own = points[order]
        return cls(piece, np.minimum.reduceat(own, starts), np.maximum.reduceat(own, starts))

    @property
    def sizes(self) -> Array:
        """Longest side of each box, (P,)."""
        return largest_of(self.high - self.low)

    def medians(self, values: Array, owner: Indices) -> Array:
        """Median of the values (n,) in each piece that `owner` (n,) names for them, (P,); NaN where there are none."""
        order = np.lexsort((values, owner))
        counts = np.bincount(owner, minlength=len(self.low))
        starts, own = np.cumsum(counts) - counts, values[order]
        medians = np.full(len(counts), np.nan)
        some = counts > 0
        first, last = (starts + (counts - 1) // 2)[some], (starts + counts // 2)[some]
        medians[some] = (own[first] + own[last]) / 2.0
        return medians

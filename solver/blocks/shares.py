"""How much each block counts at a vertex: the weights by which the blocks' surfaces are blended.

A block counts fully inside, and less and less in the halo, up to `reach` steps from its own vertices:

    W_b(p) = w_b(p) / sum_c w_c(p),    w_b(p) = max(0, 1 - hops_b(p) / (reach + 1)).

Every block computes the same shares from what its halo shows of the others.  Between vertices the shares are linear.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ..arrays import Array, Indices


def shares_of(block: int, blocks: NDArray[np.int32], corners: NDArray[np.int32], offsets: Indices, reach: int) -> Array:
    """Return the share of one block at the vertices of its part, (n,).

    Parameters
    ----------
    block, blocks
        The block, and the block that each vertex belongs to, (n,).
    corners, offsets
        The part's faces as a ragged array of its vertices.
    reach
        How many steps the block counts beyond its own vertices.
    """
    ones = np.ones(len(corners), dtype=np.int32)
    holds = csr_array((ones, corners, offsets), shape=(len(offsets) - 1, len(blocks)))
    held = holds.T.tocsr()
    own = total = np.zeros(len(blocks))
    for other in np.unique(blocks):
        raw = np.maximum(1.0 - _hops(holds, held, blocks == other, reach) / (reach + 1), 0.0)
        total = total + raw
        if other == block:
            own = raw
    return np.divide(own, total, out=np.zeros_like(own), where=own > 0.0)


def _hops(holds: csr_array, held: csr_array, reached: NDArray[np.bool_], most: int) -> Array:
    """Steps from some vertices to each vertex, (n,); `most` + 1 where it takes more than `most`."""
    hops = np.where(reached, 0.0, most + 1.0)
    for step in range(1, most + 1):
        near = (held @ (holds @ (hops < step).astype(np.int32) > 0).astype(np.int32)) > 0
        hops[near & (hops > step)] = step
    return hops

"""Points in the cells of a regular grid, and one point for each cell."""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices


def one_in_each_cell(points: Array, cell: float) -> tuple[Indices, Indices]:
    """Choose in each cell of a grid the point that is nearest to the mean there.

    Parameters
    ----------
    points
        (n, 3), at least one.
    cell
        Length of a cell's sides.

    Returns
    -------
    chosen : (W,) integers
        Which points are chosen, in the order of the cells.
    number : (n,) integers
        Each point's cell, as a row of `chosen`.
    """
    cells = np.floor(points / cell).astype(np.int64)
    _, number, count = np.unique(one_number(cells - cells.min(axis=0)), return_inverse=True, return_counts=True)
    means = np.stack([np.bincount(number, weights=column) for column in points.T], axis=1) / count[:, None]
    order = np.lexsort((((points - means[number]) ** 2).sum(axis=1), number))
    return order[np.cumsum(count) - count], number


def one_number(rows: Indices) -> Indices:
    """Return a number for each row of three that are not negative, (n,), which come in the order of the rows."""
    if not len(rows):
        return np.arange(0)
    widths = [int(width) for width in rows.max(axis=0) + 1]
    if widths[0] * widths[1] * widths[2] >= 2**63:
        return np.unique(rows, axis=0, return_inverse=True)[1].reshape(-1)
    return (rows[:, 0] * widths[1] + rows[:, 1]) * widths[2] + rows[:, 2]

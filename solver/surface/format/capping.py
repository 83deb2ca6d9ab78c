"""Any triangles as a closed, oriented mesh: cut where more than two meet, and with caps on what is open then."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Indices
from ...mesh.edges import connected_parts, edge_keys, stable_order


@dataclass(frozen=True)
class Capped:
    """A closed mesh over T triangles.

    Attributes
    ----------
    triangles
        First the given ones, then those of the caps, (F, 3); the vertices are those of the closed mesh.
    opposite
        Each side's other one, (3 F,); side 3 t + k goes from corner k to the next.
    caps
        Number of the first vertex that is a cap's centre.
    vertices
        The given vertex of each before, (caps,).
    """

    triangles: Indices
    opposite: Indices
    caps: int
    vertices: Indices

    @classmethod
    def of(cls, triangles: Indices) -> Capped:
        """Close triangles, (T, 3): a vertex is one only where triangles around it share sides."""
        opposite = opposite_sides(triangles)
        side = np.arange(triangles.size)
        paired = np.flatnonzero(opposite >= 0)
        # a side starts where the one behind its opposite does
        _, vertex = connected_parts(paired, _next(opposite[paired]), triangles.size)
        names = np.zeros(int(vertex.max(initial=-1)) + 1, dtype=np.int64)
        names[vertex] = triangles.ravel()
        border = np.flatnonzero(opposite < 0)
        leaving = np.full(len(names), -1)
        leaving[vertex[border]] = border
        start, end = vertex[border], vertex[_next(border)]
        place = np.zeros(triangles.size, dtype=np.int64)
        place[border] = np.arange(len(border))
        following = place[leaving[end]]
        _, loop = connected_parts(np.arange(len(border)), following, len(border))
        caps = np.stack([end, start, len(names) + loop], axis=1)
        first = triangles.size + 3 * np.arange(len(border))
        whole = np.concatenate([opposite, np.empty(3 * len(border), dtype=np.int64)])
        whole[border], whole[first] = first, side[border]
        # the cap's triangle behind begins where this one ends
        whole[first + 2], whole[first[following] + 1] = first[following] + 1, first + 2
        return cls(np.concatenate([vertex.reshape(-1, 3), caps]), whole, len(names), names)


def opposite_sides(triangles: Indices) -> Indices:
    """Return for each side the only other one between two vertices, if it goes the other way; else -1."""
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    keys = edge_keys(start, end, int(triangles.max(initial=0)) + 1)
    order = stable_order(keys)
    fresh = np.ones(len(order), dtype=bool)
    fresh[1:] = np.diff(keys[order]) != 0
    first = np.flatnonzero(fresh)
    two = first[np.diff(np.append(first, len(order))) == 2]
    one, other = order[two], order[two + 1]
    good = (start[one] == end[other]) & (start[one] != end[one]) & (one // 3 != other // 3)
    opposite = np.full(len(order), -1)
    opposite[one[good]], opposite[other[good]] = other[good], one[good]
    return opposite


def _next(side: Indices) -> Indices:
    return np.where(side % 3 == 2, side - 2, side + 1)

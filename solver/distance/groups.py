"""Triangles in groups of neighbours, and groups of groups: what searches descend through."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..arrays import Array, Indices

CHILDREN = 4
LEAF = 2


def along_curve(points: Array) -> Indices:
    """Return the order of points (N, 3) along a Morton curve, on which neighbours mostly follow each other."""
    low = points.min(axis=0)
    cell = ((points - low) / max(float(np.ptp(points, axis=0).max()), 1e-300) * 1023.0).astype(np.int64)
    for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
        cell = (cell | cell << shift) & mask
    return np.argsort(cell[:, 0] | cell[:, 1] << 1 | cell[:, 2] << 2, kind="stable")


def group_sizes(count: int) -> Iterator[int]:
    """Yield how many of `count` triangles in order a group has, level by level from the smallest to the largest."""
    size = LEAF
    yield size
    while -(-count // size) > CHILDREN:
        size *= CHILDREN
        yield size


def members(who: Indices, group: Indices, depth: int, count: int) -> tuple[Indices, Indices]:
    """Return pairs (N,) of a place and a group of level `depth` as pairs with its groups below, or its triangles.

    `count` is how many of those there are; the last group may have fewer.
    """
    children = CHILDREN if depth else LEAF
    below = (group[:, None] * children + np.arange(children)).ravel()
    there = below < count
    return np.repeat(who, children)[there], below[there]

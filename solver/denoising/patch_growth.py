"""Growing one-sided patches: triangles around a seed, ring after ring, as far as the normals agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]

_TABLE_ENTRIES = 1 << 24


def chunk_size(columns: int) -> int:
    """Return how many patches may grow at once on a mesh with so many triangles: their tables fit in 64 MB each."""
    return int(np.clip(_TABLE_ENTRIES // max(columns, 1), 16, 128))


class Claims:
    """A table of which patch (row) has reached which triangle or vertex (column)."""

    def __init__(self, rows: int, columns: int) -> None:
        self._holder = np.full((rows, columns), -1, dtype=np.int32)
        self._taken: list[tuple[Integers, Integers]] = []

    def claim(self, rows: Integers, columns: Integers) -> Integers:
        """Take the places that are free, and return which of the given ones that were: one for each place."""
        free = np.flatnonzero(self._holder[rows, columns] < 0)
        rows, columns = rows[free], columns[free]
        number = np.arange(len(free), dtype=np.int32)
        self._holder[rows, columns] = number  # of several for one place the last remains
        self._taken.append((rows, columns))
        return free[self._holder[rows, columns] == number]

    def number(self, rows: Integers, columns: Integers, numbers: Integers) -> None:
        """Give taken places numbers."""
        self._holder[rows, columns] = numbers

    def numbers(self, rows: Integers, columns: Integers) -> Integers:
        """Return the numbers of places."""
        return self._holder[rows, columns].astype(np.int64)

    def clear(self) -> None:
        """Free every place."""
        for rows, columns in self._taken:
            self._holder[rows, columns] = -1
        self._taken = []


@dataclass(frozen=True)
class Agreement:
    """How far normals may differ within a patch: the cosine across a side, and from the seed's normal."""

    across_side: float
    from_seed: float


class GrowingPatches:
    """Patches that grow together, one a seed; a ring is taken whole or, where it would be too much, later.

    Parameters
    ----------
    neighbours
        Triangle across each side, (T, 3), -1 where there is none.
    normals
        Unit normals, (T, 3); a triangle whose normal is zero agrees with none.
    seeds
        Triangles to start from, (P,).
    agreement
        Which triangles join.
    claims
        An empty table with a row a seed or more and a column a triangle; left filled.
    """

    def __init__(
        self, neighbours: Integers, normals: Floats, seeds: Integers, agreement: Agreement, claims: Claims
    ) -> None:
        self._neighbours, self._normals, self._agreement, self._claims = neighbours, normals, agreement, claims
        self._seeds = seeds
        rows = np.arange(len(seeds))
        claims.claim(rows, seeds)
        self._members = [(rows, seeds)]
        self._edge_of = (rows, seeds)  # the outermost ring, whose neighbours are next
        self._waiting = (rows[:0], seeds[:0])  # the ring after it, where it did not fit
        self.sizes = np.ones(len(seeds), dtype=np.int64)

    def grow(self, limit: int, wanted: Booleans) -> None:
        """Let the patches that are `wanted`, (P,), grow to at most `limit` triangles."""
        rows, triangles = (part[wanted[self._waiting[0]]] for part in self._waiting)
        edge_rows, edge_triangles = (part[wanted[self._edge_of[0]]] for part in self._edge_of)
        held: list[tuple[Integers, Integers]] = []
        while True:
            next_rows, next_triangles = self._ring_after(edge_rows, edge_triangles)
            rows, triangles = np.concatenate((rows, next_rows)), np.concatenate((triangles, next_triangles))
            if not len(rows):
                break
            more = np.bincount(rows, minlength=len(self.sizes))
            fits = (self.sizes + more <= limit)[rows]
            held.append((rows[~fits], triangles[~fits]))
            edge_rows, edge_triangles = rows[fits], triangles[fits]
            self.sizes += np.bincount(edge_rows, minlength=len(self.sizes))
            self._members.append((edge_rows, edge_triangles))
            rows, triangles = rows[:0], triangles[:0]
        self._edge_of = (edge_rows, edge_triangles)
        self._waiting = _joined(held) if held else (rows, triangles)

    def members(self, wanted: Booleans) -> tuple[Integers, Integers]:
        """Return (patch, triangle) of the `wanted` patches, sorted by patch and, within it, from the seed outwards."""
        self._members = [_joined(self._members)]
        rows, triangles = (part[wanted[self._members[0][0]]] for part in self._members[0])
        order = np.argsort(rows, kind="stable")
        return rows[order], triangles[order]

    def _ring_after(self, rows: Integers, triangles: Integers) -> tuple[Integers, Integers]:
        patch, source = np.repeat(rows, 3), np.repeat(triangles, 3)
        target = self._neighbours[triangles].ravel()
        exists = target >= 0
        patch, source, target = patch[exists], source[exists], target[exists]
        normal = self._normals[target]
        like_side = (self._normals[source] * normal).sum(axis=1) > self._agreement.across_side
        like_seed = (self._normals[self._seeds[patch]] * normal).sum(axis=1) > self._agreement.from_seed
        agreeing = np.flatnonzero(like_side & like_seed)
        new = agreeing[self._claims.claim(patch[agreeing], target[agreeing])]
        return patch[new], target[new]


def _joined(parts: list[tuple[Integers, Integers]]) -> tuple[Integers, Integers]:
    return np.concatenate([rows for rows, _ in parts]), np.concatenate([columns for _, columns in parts])

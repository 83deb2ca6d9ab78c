"""Growing one-sided patches: triangles around a seed, ring after ring, as far as the normals agree."""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Booleans, Indices
from ..native.library import reason_against
from ..native.patch_growth import Listed, NativeGrowth

_TABLE_ENTRIES = 1 << 24
_MOST_RINGS = 3.0  # times the square root of the number of triangles


def chunk_size(columns: int) -> int:
    """Return how many patches may grow at once on a mesh with this many triangles.

    Their tables fit in 64 MB each, except on large meshes: fewer patches at once take longer, 16 nearly twice as long.
    """
    return int(np.clip(_TABLE_ENTRIES // max(columns, 1), 64, 128))


def most_rings(limit: int) -> int:
    """Return how many rings a patch of so many triangles may have."""
    return int(np.ceil(_MOST_RINGS * np.sqrt(limit)))


class Claims:
    """A table of which patch (row) has reached which triangle or vertex (column), addressed by places."""

    def __init__(self, rows: int, columns: int) -> None:
        # One more column, which is never free: column -1, of no neighbour, comes out there, in the row before.
        self._width = columns + 1
        self._holder = np.full(rows * self._width, -1, dtype=np.int32)
        self._holder[columns :: self._width] = 0
        self._taken: list[Indices] = []

    def places(self, rows: Indices, columns: Indices, repeats: int = 1) -> Indices:
        """Return the places of rows, each for so many columns; a column of -1 has a place that is never free."""
        starts = rows * self._width
        places: Indices = (starts if repeats == 1 else np.repeat(starts, repeats)) + columns
        return places

    def free(self, places: Indices) -> Indices:
        """Return which of the places are free."""
        return (self._holder[places] < 0).nonzero()[0]

    def claim(self, places: Indices) -> Indices:
        """Take places that are free, and return which of the given ones to keep: one for each place."""
        number = np.arange(len(places), dtype=np.int32)
        self._holder[places] = number  # of several for one place the last remains
        one = (self._holder[places] == number).nonzero()[0]
        self._taken.append(places[one])
        return one

    def number(self, places: Indices, numbers: Indices) -> None:
        """Give taken places numbers."""
        self._holder[places] = numbers

    def numbers(self, places: Indices) -> Indices:
        """Return the numbers of places."""
        return self._holder[places].astype(np.int64)

    def clear(self) -> None:
        """Free every place."""
        for places in self._taken:
            self._holder[places] = -1
        self._taken = []


def agreeing_neighbours(neighbours: Indices, normals: Array, least_cosine: float) -> Indices:
    """Return the neighbours across each side, (T, 3), -1 where the two normals differ by more than the given angle."""
    cosine = np.einsum("tc,tsc->ts", normals, normals[neighbours])
    return np.where((neighbours >= 0) & (cosine > least_cosine), neighbours, -1)


class GrowingPatches:
    """Patches that grow together, one a seed; a ring is taken whole or, where it would be too much, later.

    Parameters
    ----------
    neighbours
        Triangle that may join across each side, (T, 3), -1 where none may.
    normals
        Unit normals, (T, 3).
    seeds
        Triangles to start from, (P,).
    least_cosine
        Of the angle between the normal of a triangle that joins and the seed's.
    claims
        An empty table with a row a seed or more and a column a triangle; left filled.
    """

    def __init__(
        self, neighbours: Indices, normals: Array, seeds: Indices, least_cosine: float, claims: Claims
    ) -> None:
        self._neighbours, self._normals, self._least_cosine, self._claims = neighbours, normals, least_cosine, claims
        self._upright = normals[seeds]
        rows = np.arange(len(seeds))
        claims.claim(claims.places(rows, seeds))
        self._members = [(rows, seeds)]
        self._outermost = (rows, seeds)
        self._waiting = (rows[:0], seeds[:0])  # the ring after the outermost, where it did not fit
        self._rings = 0
        self.sizes = np.ones(len(seeds), dtype=np.int64)

    def grow(self, limit: int, wanted: Booleans) -> None:
        """Let the patches that are `wanted`, (P,), grow to at most `limit` triangles.

        The number of rings is limited too: a round patch of n triangles has sqrt(2 n / 3), one that winds itself
        through noise or along a narrow strip has many more.
        """
        rows, triangles = (part[wanted[self._waiting[0]]] for part in self._waiting)
        outer_rows, outer_triangles = (part[wanted[self._outermost[0]]] for part in self._outermost)
        held: list[tuple[Indices, Indices]] = []
        while self._rings < most_rings(limit):
            next_rows, next_triangles = self._ring_after(outer_rows, outer_triangles)
            rows, triangles = np.concatenate((rows, next_rows)), np.concatenate((triangles, next_triangles))
            if not len(rows):
                break
            more = np.bincount(rows, minlength=len(self.sizes))
            fits = (self.sizes + more <= limit)[rows]
            held.append((rows[~fits], triangles[~fits]))
            outer_rows, outer_triangles = rows[fits], triangles[fits]
            self.sizes += np.bincount(outer_rows, minlength=len(self.sizes))
            self._members.append((outer_rows, outer_triangles))
            self._rings += 1
            rows, triangles = rows[:0], triangles[:0]
        self._outermost = (outer_rows, outer_triangles)
        self._waiting = _joined([(rows, triangles), *held])

    def members(self, wanted: Booleans) -> tuple[Indices, Indices]:
        """Return (patch, triangle) of the `wanted` patches, sorted by patch and, within it, from the seed outwards."""
        self._members = [_joined(self._members)]
        rows, triangles = (part[wanted[self._members[0][0]]] for part in self._members[0])
        order = np.argsort(rows, kind="stable")
        return rows[order], triangles[order]

    def _ring_after(self, rows: Indices, triangles: Indices) -> tuple[Indices, Indices]:
        triangle = self._neighbours[triangles].ravel()
        place = self._claims.places(rows, triangle, repeats=3)
        new = self._claims.free(place)
        patch, triangle = rows[new // 3], triangle[new]
        cosine = np.einsum("nc,nc->n", self._upright[patch], self._normals[triangle])
        like_seed = (cosine > self._least_cosine).nonzero()[0]
        one = like_seed[self._claims.claim(place[new[like_seed]])]
        return patch[one], triangle[one]


class PlainGrowth:
    """Patches that grow together on one mesh, batch after batch, by NumPy.

    Parameters
    ----------
    triangles
        Vertices of the corners, (T, 3).
    vertex_count
        Of the mesh.
    neighbours, normals, least_cosine
        As in `GrowingPatches`.
    most
        Patches that grow at once.
    """

    def __init__(
        self,
        triangles: Indices,
        vertex_count: int,
        neighbours: Indices,
        normals: Array,
        least_cosine: float,
        most: int,
    ) -> None:
        self._triangles, self._neighbours, self._normals = triangles, neighbours, normals
        self._least_cosine = least_cosine
        self._triangle_claims, self._vertex_claims = Claims(most, len(triangles)), Claims(most, vertex_count)
        self.begin(np.zeros(0, dtype=np.int64))

    @property
    def sizes(self) -> Indices:
        """Triangles of each patch, (P,)."""
        return self._growing.sizes

    def begin(self, seeds: Indices) -> None:
        """Start again with patches of one triangle each, (P,)."""
        self._triangle_claims.clear()
        start = self._neighbours, self._normals, seeds, self._least_cosine, self._triangle_claims
        self._growing = GrowingPatches(*start)

    def grow(self, limit: int, wanted: Booleans) -> None:
        """Let the patches that are `wanted`, (P,), grow to at most `limit` triangles."""
        self._growing.grow(limit, wanted)

    def listed(self, wanted: Booleans) -> Listed:
        """Return the `wanted` patches, (P,)."""
        rows, members = self._growing.members(wanted)
        rows, count = (np.cumsum(wanted) - 1)[rows], int(wanted.sum())
        triangles, _ = _padded(rows, members, count)
        corner_rows, corners = np.repeat(rows, 3), self._triangles[members].ravel()
        places = self._vertex_claims.places(corner_rows, corners)
        one = self._vertex_claims.claim(places)
        vertices, slots = _padded(corner_rows[one], corners[one], count)
        self._vertex_claims.number(places[one], slots)
        corner_places = corner_rows * vertices.shape[1] + self._vertex_claims.numbers(places)
        self._vertex_claims.clear()
        return Listed(triangles, vertices, corner_places)


def growth_on(
    triangles: Indices,
    vertex_count: int,
    neighbours: Indices,
    normals: Array,
    least_cosine: float,
    most: int,
    largest: int,
) -> PlainGrowth | NativeGrowth:
    """Return what lets at most `most` patches grow at once to at most `largest` triangles; see `PlainGrowth`."""
    mesh = triangles, vertex_count, neighbours, normals, least_cosine
    return NativeGrowth(*mesh, largest, most_rings) if reason_against() is None else PlainGrowth(*mesh, most)


def _padded(rows: Indices, members: Indices, count: int) -> tuple[Indices, Indices]:
    """Return ragged members, sorted by row, as (count, K) padded with -1, and the column of each."""
    sizes = np.bincount(rows, minlength=count)
    columns = np.arange(len(rows)) - (np.cumsum(sizes) - sizes)[rows]
    padded = np.full((count, int(sizes.max(initial=0))), -1, dtype=np.int64)
    padded[rows, columns] = members
    return padded, columns


def _joined(parts: list[tuple[Indices, Indices]]) -> tuple[Indices, Indices]:
    return np.concatenate([rows for rows, _ in parts]), np.concatenate([columns for _, columns in parts])

"""A walk over a triangle mesh: how many triangles its vertices have, in the order in which it meets them, is the mesh.

The walk fills a closed, oriented surface from one triangle on.  What is filled ends in *fronts*: cycles of places, each
at a vertex.  Vertex after vertex, as they were met, the gap at each of its places is filled by a fan, from the place
before to the place behind, with new vertices between them.  Where a vertex between them is not new, a *chord* to its
place cuts the front in two first, or makes one of two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Indices
from ...native.library import reason_against
from ...native.stored import fans_of_walk
from ..container import demand

GONE = -1


@dataclass(frozen=True)
class Walk:
    """A closed mesh of n vertices, numbered as they are met.

    Attributes
    ----------
    valences
        Triangles of each vertex, (n,).
    forks
        Vertices at which chords begin, ascending.
    gaps
        For each gap of each vertex that is a fork or has several places: 0 where a chord begins, which leaves two gaps,
        else 1 more than the number of new vertices.
    targets
        For each chord how far the place where it ends was made before the place where it begins.
    """

    valences: Indices
    forks: Indices
    gaps: Indices
    targets: Indices

    def triangles(self, most: int) -> Indices:
        """Return the triangles, (F, 3), fan after fan.

        Raises
        ------
        Refusal
            When there are more than `most`, or the numbers are not those of a walk.
        """
        demand(self.valences.min(initial=1) >= 0 and int(self.valences.sum()) <= 3 * most, "a walk is too long")
        fans, met = _filled(self) if reason_against() else _filled_natively(self)
        centre, start, end, new, first = fans.T
        demand(met == len(self.valences) and int((new + 1).sum()) <= most, "a walk has too many triangles")
        ends = np.cumsum(new + 1)
        of = np.repeat(np.arange(len(fans)), new + 1)
        rank = np.arange(len(of)) - np.repeat(ends - new - 1, new + 1)
        one = np.where(rank == 0, start[of], first[of] + rank - 1)
        two = np.where(rank == new[of], end[of], first[of] + rank)
        return np.stack([centre[of], one, two], axis=1)


def _filled(walk: Walk) -> tuple[Indices, int]:
    """Return the fans, (n, 5): centre, before, behind, number of new vertices, first of them; and the vertices met."""
    filling = _Filling(walk)
    try:
        filling.fill()
    except IndexError:
        demand(False, "a walk is cut")
    return np.array(filling.fans, dtype=np.int64).reshape(-1, 5), filling.met


def _filled_natively(walk: Walk) -> tuple[Indices, int]:
    """Return the same by the compiled kernel."""
    found = fans_of_walk(walk.valences, walk.forks, walk.gaps, walk.targets)
    demand(found is not None, "a walk is cut")
    assert found is not None
    return found


class Front:
    """Cycles of places: `after` and `before` each, and its `vertex`; the first place of a vertex has its number.

    Places after those of `count` vertices are made by chords.
    """

    def __init__(self, count: int) -> None:
        # new vertices follow each other, so most places are linked before they are met
        self.after = list(range(1, count + 1))
        self.before = list(range(-1, count - 1))
        self.vertex = list(range(count))
        self.more: dict[int, list[int]] = {}

    def begin(self, first: int) -> None:
        """Make the three corners of a triangle a front."""
        self.before[first], self.after[first + 2] = first + 2, first

    def places(self, vertex: int) -> list[int]:
        """Places at a vertex where something is left to fill."""
        return [place for place in (*self.more.get(vertex, ()), vertex) if self.after[place] != GONE]

    def cut(self, start: int, end: int) -> tuple[int, int]:
        """Draw a chord between two places; return the new places at its ends.

        The gap at `start` is divided into that of the new place, which is first, and that of `start`, which is left.
        """
        first, second = len(self.vertex), len(self.vertex) + 1
        self.vertex += [self.vertex[start], self.vertex[end]]
        self.before += [self.before[start], first]
        self.after += [second, self.after[end]]
        self.after[self.before[start]], self.before[self.after[end]] = first, second
        self.before[start], self.after[end] = end, start
        for place in (first, second):
            self.more.setdefault(self.vertex[place], []).append(place)
        return first, second

    def fill(self, place: int, first: int, new: int) -> None:
        """Fill the gap at a place with a fan that has some new vertices, numbered from the first on."""
        before, after = self.before[place], self.after[place]
        self.after[place] = GONE
        if new:
            self.after[before], self.before[first] = first, before
            self.after[first + new - 1], self.before[after] = after, first + new - 1
        else:
            self.close(before, after)

    def close(self, before: int, after: int) -> None:
        """Link two places, and close up what is empty: a place between two places of one vertex."""
        self.after[before], self.before[after] = after, before
        for place in (before, after):
            while self.after[place] != GONE:
                one, two = self.before[place], self.after[place]
                if self.vertex[one] != self.vertex[two]:
                    break
                self.after[place] = GONE
                self.joined(one, two)
                place = one

    def joined(self, one: int, two: int) -> None:
        """Make one place of two at a vertex, with nothing between them."""
        if one == two:
            self.after[one] = GONE
            return
        self.after[one], self.before[self.after[two]] = self.after[two], one
        self.after[two] = GONE


class _Filling:
    """Follows a walk, and notes its fans: around which vertex, between which, and with which new ones."""

    def __init__(self, walk: Walk) -> None:
        self._walk, self.met = walk, 0
        self._left = (walk.valences - 3).tolist()
        self._gaps, self._targets = iter(walk.gaps.tolist()), iter(walk.targets.tolist())
        self._front = Front(len(walk.valences))
        self.fans: list[tuple[int, int, int, int, int]] = []

    def fill(self) -> None:
        """Fill the gaps of all vertices."""
        front, left, fans = self._front, self._left, self.fans
        before, after, vertex, more = front.before, front.after, front.vertex, front.more
        forks = set(self._walk.forks.tolist())
        for centre in range(len(left)):
            if centre == self.met:
                self._begin(centre)
            if centre in more or centre in forks:
                self._fill_each(centre, centre in forks)
                continue
            behind = after[centre]
            if behind == GONE:
                continue
            new, ahead, first = left[centre], before[centre], self.met
            # the same as `_fan`, which would take twice the time
            fans.append((centre, vertex[ahead], vertex[behind], new, first))
            left[vertex[ahead]] -= 1
            left[vertex[behind]] -= 1
            if new > 0:
                self.met = first + new
                after[ahead], before[first] = first, ahead
                after[self.met - 1], before[behind] = behind, self.met - 1
            else:
                demand(new == 0, "a vertex has too few triangles")
                front.close(ahead, behind)

    def _begin(self, first: int) -> None:
        self.fans.append((first, first + 1, first + 2, 0, first))
        self._front.begin(first)
        for corner in range(first, first + 3):
            self._left[corner] += 1
        self.met += 3

    def _fill_each(self, centre: int, is_fork: bool) -> None:
        """Fill the gaps of a vertex with several."""
        waiting = self._front.places(centre)
        if not is_fork and len(waiting) == 1:
            self._fan(waiting[0], self._left[centre])
            return
        while waiting:
            place = waiting.pop()
            if self._front.after[place] == GONE:
                continue
            new = next(self._gaps, GONE - 1) - 1
            if new >= 0:
                self._fan(place, new)
                continue
            end = place - next(self._targets, place)
            reached = 0 <= end < self.met or len(self._left) <= end < len(self._front.vertex)
            demand(new == GONE and reached, "a chord leads nowhere")
            demand(self._front.after[end] != GONE and end != place, "a chord leads to what is filled")
            waiting += [place, self._front.cut(place, end)[0]]

    def _fan(self, place: int, new: int) -> None:
        front, first = self._front, self.met
        demand(0 <= new <= len(self._left) - first, "a vertex has a wrong number of triangles")
        ends = front.before[place], front.after[place]
        for end in ends:
            self._left[front.vertex[end]] -= 1
        self.fans.append((front.vertex[place], front.vertex[ends[0]], front.vertex[ends[1]], new, first))
        self.met += new
        front.fill(place, first, new)


class NotWalkedError(Exception):
    """The mesh is none that a walk leads to again."""


class _SidedFront(Front):
    """A front that knows the `side` from each place to the one behind, of the triangle that is not in the gap."""

    def __init__(self, count: int) -> None:
        super().__init__(count)
        self.side, self._place = [GONE] * count, dict[int, int]()

    def look(self, place: int, side: int) -> None:
        """Note a place's side."""
        self.side[place], self._place[side] = side, place

    def place_of(self, side: int) -> int:
        """Return the place that has a side, or `GONE`."""
        place = self._place.get(side, GONE)
        return place if place != GONE and self.side[place] == side and self.after[place] != GONE else GONE

    def joined(self, one: int, two: int) -> None:
        super().joined(one, two)
        if one != two:
            self.look(one, self.side[two])


class Walking:
    """Walks over a closed mesh, and notes what a `Walk` holds.

    Attributes
    ----------
    corners
        The corners of the mesh's triangles in the order of the walk, from the fan's centre on, (3 F,) as 3 t + k.
    met
        The vertices in the order in which they were met.
    """

    def __init__(self, triangles: Indices, opposite: Indices) -> None:
        """Walk over triangles (F, 3); side 3 t + k goes from corner k to the next, and has an opposite side each."""
        self._start, self._opposite = triangles.ravel().tolist(), opposite.tolist()
        self._number = [-1] * (max(self._start, default=-1) + 1)
        self._count = np.bincount(triangles.ravel(), minlength=len(self._number))
        self._front = _SidedFront(len(self._number))
        self._forks: list[int] = []
        self._gaps: list[int] = []
        self._targets: list[int] = []
        self._taken = bytearray(len(triangles))
        self.corners: list[int] = []
        self.met: list[int] = []
        self._walk()

    def walk(self) -> Walk:
        """Return what was noted."""
        noted = (self._count[self.met], self._forks, self._gaps, self._targets)
        return Walk(*(np.array(numbers, dtype=np.int64) for numbers in noted))

    def _walk(self) -> None:
        done = seed = 0
        while seed < len(self._taken):
            if self._taken[seed]:
                seed += 1
                continue
            self._begin(seed)
            while done < len(self.met):
                self._fill_each(done)
                done += 1

    def _begin(self, seed: int) -> None:
        sides = [3 * seed, 3 * seed + 1, 3 * seed + 2]
        first = len(self.met)
        for side in sides:
            self._meet(self._start[side])
        self._take(sides[0])
        if len(self.met) != first + 3:
            raise NotWalkedError
        self._front.begin(first)
        for place, side in enumerate(sides, first):
            self._front.look(place, side)

    def _meet(self, vertex: int) -> None:
        if self._number[vertex] >= 0:
            raise NotWalkedError
        self._number[vertex] = len(self.met)
        self.met.append(vertex)

    def _take(self, corner: int) -> None:
        if self._taken[corner // 3]:
            raise NotWalkedError
        self._taken[corner // 3] = 1
        self.corners += [corner, _next(corner), _next(_next(corner))]

    def _fill_each(self, centre: int) -> None:
        front = self._front
        waiting = front.places(centre)
        noted = len(self._gaps)
        several = len(waiting) > 1
        while waiting:
            place = waiting.pop()
            if front.after[place] == GONE:
                continue
            fan = self._fan(place)
            between = [self._start[_next(_next(side))] for side in fan[:-1]]
            old = next((k for k, vertex in enumerate(between) if self._number[vertex] >= 0), None)
            if old is None:
                self._gaps.append(len(between) + 1)
                self._fill(place, fan, between)
            else:
                several = True
                self._gaps.append(0)
                waiting += [place, self._cut(centre, place, _next(_next(fan[old])))]
        if not several:
            del self._gaps[noted:]

    def _fan(self, place: int) -> list[int]:
        """Return the sides at which the triangles of a gap begin: from the centre to the place before, and on."""
        front, last = self._front, self._opposite[self._front.side[place]]
        side, fan = self._opposite[front.side[front.before[place]]], []
        while True:
            fan.append(side)
            back = _next(_next(side))
            if back == last:
                return fan
            side = self._opposite[back]
            if len(fan) > len(self._taken):
                raise NotWalkedError

    def _fill(self, place: int, fan: list[int], between: list[int]) -> None:
        front, first, before = self._front, len(self.met), self._front.before[place]
        for vertex in between:
            self._meet(vertex)
        for side in fan:
            self._take(side)
        for own, side in zip([before, *range(first, first + len(between))], fan, strict=True):
            self._front.look(own, _next(side))
        front.fill(place, first, len(between))

    def _cut(self, centre: int, place: int, side: int) -> int:
        """Draw a chord along a side that ends at the place's vertex; return the place whose gap is first."""
        front = self._front
        if not self._forks or self._forks[-1] != centre:
            self._forks.append(centre)
        end = self._place_at(side)
        self._targets.append(place - end)
        new, other = front.cut(place, end)
        front.side += [GONE, GONE]
        front.look(other, front.side[end])
        front.look(end, side)
        front.look(new, self._opposite[side])
        return new

    def _place_at(self, side: int) -> int:
        """Return the place at the start of a side whose gap the side lies in."""
        for _ in range(len(self._taken)):
            side = self._opposite[_next(_next(side))]
            if (place := self._front.place_of(side)) != GONE:
                return place
        raise NotWalkedError


def _next(corner: int) -> int:
    return corner - 2 if corner % 3 == 2 else corner + 1

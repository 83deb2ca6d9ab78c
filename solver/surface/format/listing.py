"""In which order a mesh lists its faces and vertices: mostly each next one lies near the one before.

A *place* is a corner 3 t + k of a triangle.  A *move* leads from a place to another: over up to three sides, then to a
corner of the triangle that is reached.  What no short move reaches is counted among what is left: a *jump*.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...arrays import Indices
from ...native.library import reason_against
from ...native.stored import places_listed
from ..container import demand
from .blocks import BlockReader, BlockWriter

REACH = 3
"""Most sides that a move goes over."""


def _paths() -> list[tuple[int, ...]]:
    """Sides that paths go over, each counted from where the one before came in: that one, 0, leads back."""
    paths: list[tuple[int, ...]] = [(), (0,), (1,), (2,)]
    for known in (slice(1, 4), slice(4, 10)):
        paths += [(*path, side) for path in paths[known] for side in (1, 2)]
    return paths


PATHS = _paths()
MOVES = 3 * len(PATHS) + 1
_PARENTS = [PATHS.index(path[:-1]) for path in PATHS]

_Turn = Callable[[int, int, int], int]


@dataclass(frozen=True)
class Listing:
    """An order of n items, of which each has one or more places.

    Attributes
    ----------
    moves
        For each item the move from the place of the one before, (n,): 1 + 3 * path + turn, or 0.
    returns
        For each 0 among them a move from where the last jump or return led, or 0.
    jumps
        For each 0 among these how many of the items that are left come before it.
    turns
        For each jump how far its place is from the item's first one.
    """

    moves: Indices
    returns: Indices
    jumps: Indices
    turns: Indices

    @classmethod
    def read(cls, blocks: BlockReader, name: str, count: int) -> Listing:
        """Return what `write` added for `count` items."""
        moves = blocks.whole(f"{name}_moves", count)
        returns = blocks.whole(f"{name}_returns", int((moves == 0).sum()))
        jumps = blocks.whole(f"{name}_jumps", int((returns == 0).sum()))
        turns = blocks.whole(f"{name}_turns", len(jumps))
        for numbers, end in ((moves, MOVES), (returns, MOVES), (jumps, count), (turns, 3)):
            demand(numbers.min(initial=0) >= 0 and numbers.max(initial=0) < max(end, 1), f"{name}s have a wrong order")
        return cls(moves, returns, jumps, turns)

    def write(self, blocks: BlockWriter, name: str) -> None:
        """Add blocks."""
        blocks.whole(f"{name}_moves", self.moves)
        blocks.whole(f"{name}_returns", self.returns)
        blocks.whole(f"{name}_jumps", self.jumps)
        blocks.whole(f"{name}_turns", self.turns)

    def places(self, opposite: Indices, items: Indices, first: Indices) -> Indices:
        """Return the place to which each item leads, (n,).

        Parameters
        ----------
        opposite
            For each place, (3 T,), the other side of the one that begins there, or -1.
        items
            The item at each place, (3 T,).
        first
            A place of each item, (n,).

        Raises
        ------
        Refusal
            When a move leads nowhere, or two to one item.
        """
        if reason_against():
            return self._places(opposite.tolist(), items.tolist(), first.tolist())
        numbers = self.moves, self.returns, self.jumps, self.turns
        found = places_listed(opposite, items, first, *numbers)
        demand(found is not None, "an order leads nowhere")
        assert found is not None
        return found

    def _places(self, opposite: list[int], items: list[int], first: list[int]) -> Indices:
        left, found = _Left(len(first)), []
        taken, place, back = bytearray(len(first)), -1, -1
        returns, jumps, turns = (iter(part.tolist()) for part in (self.returns, self.jumps, self.turns))
        for move in self.moves.tolist():
            if move:
                place = _followed(opposite, place, move)
            else:
                move = next(returns)
                if move:
                    place = _followed(opposite, back, move)
                else:
                    jump = next(jumps)
                    demand(jump < left.count, "an order leads nowhere")
                    place = _turned(first[left.find(jump)], next(turns))
                back = place
            demand(place >= 0 and not taken[items[place]], "an order leads nowhere")
            taken[items[place]] = 1
            left.remove(items[place])
            found.append(place)
        return np.array(found, dtype=np.int64)


class _Left:
    """Numbers from 0 to below n of which some are gone: sums over ranges whose sizes are powers of two."""

    def __init__(self, count: int) -> None:
        self.count = count
        self._sums = [k & -k for k in range(count + 1)]
        self._top = 1 << count.bit_length()

    def find(self, rank: int) -> int:
        """Return the number that as many others that are left come before."""
        place, size = 0, self._top
        while size := size >> 1:
            if place + size < len(self._sums) and self._sums[place + size] <= rank:
                place += size
                rank -= self._sums[place]
        return place

    def rank(self, number: int) -> int:
        """Return how many that are left come before a number."""
        total = 0
        while number:
            total += self._sums[number]
            number &= number - 1
        return total

    def remove(self, number: int) -> None:
        """Take a number away."""
        self.count -= 1
        number += 1
        while number < len(self._sums):
            self._sums[number] -= 1
            number += number & -number


def _turned(place: int, turn: int) -> int:
    return place - place % 3 + (place + turn) % 3


def _followed(opposite: list[int], place: int, move: int) -> int:
    """Return where a move leads, or -1."""
    for side in PATHS[(move - 1) // 3]:
        if place < 0:
            return -1
        place = opposite[_turned(place, side)]
    return _turned(place, (move - 1) % 3) if place >= 0 else -1


def listing_of_faces(opposite: Indices, wanted: Indices, reach: int) -> Listing:
    """Return the order of T triangles that begin at the places `wanted`, (T,)."""
    sides, begins = opposite.tolist(), wanted.tolist()

    def turn(_: int, place: int, item: int) -> int:
        return (begins[item] - place) % 3 if place // 3 == begins[item] // 3 else -1

    triangles = wanted // 3
    return _listing(sides, triangles, 3 * triangles, wanted % 3, turn, reach)


def listing_of_vertices(opposite: Indices, items: Indices, first: Indices, order: Indices, reach: int) -> Listing:
    """Return an order of n items, each at one place or more; see `Listing.places`."""
    sides, own, at = opposite.tolist(), items.tolist(), order.tolist()

    def turn(path: int, place: int, item: int) -> int:
        # others of a triangle that is entered were there before
        turns = (1, 2) if path == 0 else (2,)
        return next((turn for turn in turns if own[_turned(place, turn)] == at[item]), -1)

    return _listing(sides, order, first[order], np.zeros_like(order), turn, reach)


def _listing(sides: list[int], order: Indices, at: Indices, turns: Indices, turn: _Turn, reach: int) -> Listing:
    """Find moves; `turn` says how far an item's place is from one to which a path leads, or -1."""
    paths = [path for path in range(len(PATHS)) if reach and len(PATHS[path]) <= reach]

    def move_to(item: int, start: int) -> tuple[int, int]:
        """Return the first move that leads to an item, and where it leads; or 0."""
        ends = [start]
        for path in paths if start >= 0 else ():
            if path:
                before = ends[_PARENTS[path]]
                ends.append(sides[_turned(before, PATHS[path][-1])] if before >= 0 else -1)
            if ends[path] >= 0 and (found := turn(path, ends[path], item)) >= 0:
                return 1 + 3 * path + found, _turned(ends[path], found)
        return 0, start

    left, place, back = _Left(len(order)), -1, -1
    moves, returns, jumps, begins = list[int](), list[int](), list[int](), list[int]()
    for item, number in enumerate(order.tolist()):
        move, place = move_to(item, place)
        moves.append(move)
        if not move:
            move, place = move_to(item, back)
            returns.append(move)
            if not move:
                jumps.append(left.rank(number))
                begins.append(int(turns[item]))
                place = _turned(int(at[item]), begins[-1])
            back = place
        left.remove(number)
    return Listing(*(np.array(part, dtype=np.int64) for part in (moves, returns, jumps, begins)))

"""What reading does number after number, by the compiled kernel: `entropy.c`, `growth.c`, `walk.c`, `listing.c`."""

from __future__ import annotations

from collections.abc import Iterator
from ctypes import Structure, addressof, byref, c_int64, c_void_p
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Booleans, Indices
from .library import function

Places = NDArray[np.int64] | NDArray[np.int32]

CUT_SHORT = 4
"""What the kernel returns where a file holds less than it says, or numbers that lead nowhere."""


def _run(name: str, *arguments: Any) -> bool:
    """Call a function of the kernel; return whether the file held what it needed."""
    status = function(name)(*arguments)
    if status not in (0, CUT_SHORT):
        raise MemoryError("There is not enough memory to read the file.")
    return status == 0


def _address(array: NDArray[Any]) -> c_void_p:
    return c_void_p(array.ctypes.data)


class _StoredNumbers(Structure):
    _fields_ = (
        *((name, c_int64) for name in ("lanes", "symbols", "words", "bits")),
        *((name, c_void_p) for name in ("symbol", "frequency", "start", "word", "bit", "state")),
        *((name, c_int64) for name in ("taken", "next_word", "next_bit")),
    )


class StoredNumbers:
    """Numbers that `surface.format.entropy` stored, in C contexts with tables of S symbols each.

    Parameters
    ----------
    slots
        The symbol of each slot of a context, (C, 4096), bytes.
    frequency, start
        How many slots a symbol has, and the first of them, (C, S) both.
    states
        Those of the lanes, (L,).
    words
        What fills the states up.
    bits
        The plain bits as bytes; 16 more than they need.
    """

    def __init__(
        self,
        slots: NDArray[np.uint8],
        frequency: NDArray[np.uint64],
        start: NDArray[np.uint64],
        states: NDArray[np.uint64],
        words: NDArray[np.uint64],
        bits: NDArray[np.uint8],
    ) -> None:
        kept = [np.ascontiguousarray(part) for part in (slots, frequency, start, words, bits, states.copy())]
        self._kept, sizes = kept, (len(states), frequency.shape[1], len(words), 8 * (len(bits) - 16))
        self.own = _StoredNumbers(*sizes, *(part.ctypes.data for part in kept), 0, 0, 0)

    def take(self, contexts: Indices) -> Indices | None:
        """Return the next numbers, (n,), for contexts (n,) that have tables; None where there are too few."""
        given, found = np.ascontiguousarray(contexts, dtype=np.int64), np.empty(len(contexts), dtype=np.int64)
        enough = _run("next_numbers", byref(self.own), c_int64(len(given)), _address(given), _address(found))
        return found if enough else None


class Links(Structure):
    """`Links` of growth.c."""

    _fields_ = (
        *((name, c_int64) for name in ("links", "width", "places")),
        ("row", c_void_p),
        ("groups", c_int64),
        ("group", c_void_p),
    )

    kept: tuple[NDArray[Any], ...] = ()

    @classmethod
    def of(cls, rows: NDArray[np.int32], groups: Indices) -> Links:
        """Take links between places.

        Parameters
        ----------
        rows
            Targets and what predicts them, (Q, 1 + n).
        groups
            Where the places of each of K groups begin, (K + 1,), which no link leaves.
        """
        places = int(groups[-1])
        if rows.size and not 0 <= rows.min() <= rows.max() < places:
            raise IndexError("A link names a place that is not there.")
        links = cls(len(rows), rows.shape[1] - 1, places, rows.ctypes.data, len(groups) - 1, groups.ctypes.data)
        links.kept = rows, groups  # as long as their addresses
        return links


class _Order(Structure):
    _fields_ = (
        *((name, c_void_p) for name in ("known", "place", "link", "owner", "places", "links")),
        ("rounds", c_int64),
    )


def rows_of_links(targets: Places, sources: Places) -> NDArray[np.int32]:
    """Targets (Q,) and what predicts them, (Q, n), as rows (Q, 1 + n)."""
    rows = np.empty((len(targets), 1 + sources.shape[1]), dtype=np.int32)
    rows[:, 0], rows[:, 1:] = targets, sources
    return rows


def rounds(targets: Places, sources: Places, known: Booleans) -> Iterator[tuple[Indices, Indices, Indices]]:
    """Yield what `surface.format.growth.rounds` yields; `known` is changed before the first round."""
    count, places = len(targets), len(known)
    rows = rows_of_links(targets, sources)
    lengths = (places, count, count, places + 1, places + 1)
    made = [np.empty(length, dtype=np.int64) for length in lengths]
    marks = np.ascontiguousarray(known).view(np.uint8)
    links = Links.of(rows, np.array([0, places]))
    order = _Order(marks.ctypes.data, *(part.ctypes.data for part in made), 0)
    _run("growth", byref(links), c_void_p(addressof(order)))
    known[:] = marks.view(bool)
    place, link, owner, place_ends, link_ends = made
    for k in range(order.rounds):
        own = slice(link_ends[k], link_ends[k + 1])
        yield place[place_ends[k] : place_ends[k + 1]], link[own], owner[own]


class _StoredWalk(Structure):
    _fields_ = (
        *((name, c_int64) for name in ("vertices", "gap_count", "chords")),
        *((name, c_void_p) for name in ("left", "fork", "gap", "chord", "fan")),
        *((name, c_int64) for name in ("most_fans", "fans", "met")),
    )


def fans_of_walk(valences: Indices, forks: Indices, gaps: Indices, chords: Indices) -> tuple[Indices, int] | None:
    """Fans of a `surface.format.walk.Walk`, (n, 5), and how many vertices were met; None where it is none."""
    count = len(valences)
    if len(forks) and not 0 <= forks.min() <= forks.max() < count:
        return None
    fork = np.zeros(count, dtype=np.uint8)
    fork[forks] = 1
    left = np.asarray(valences, dtype=np.int64) - 3
    gap, chord = (np.ascontiguousarray(part, dtype=np.int64) for part in (gaps, chords))
    # each place has one, and each part of the mesh begins with one
    fans = np.empty((2 * count + 4 * len(chord), 5), dtype=np.int64)
    addresses = (part.ctypes.data for part in (left, fork, gap, chord, fans))
    walk = _StoredWalk(count, len(gap), len(chord), *addresses, len(fans), 0, 0)
    return (fans[: walk.fans], walk.met) if _run("fans_of_walk", byref(walk)) else None


class _Listing(Structure):
    _fields_ = (
        *((name, c_int64) for name in ("items", "backs", "jumps")),
        *((name, c_void_p) for name in ("opposite", "item", "first", "move", "back", "jump", "turn", "place")),
    )


def places_listed(
    opposite: Indices,
    items: Indices,
    first: Indices,
    moves: Indices,
    returns: Indices,
    jumps: Indices,
    turns: Indices,
) -> Indices | None:
    """Return what `surface.format.listing.Listing.places` does; None where an order leads nowhere."""
    parts = (opposite, items, first, moves, returns, jumps, turns)
    kept = [np.ascontiguousarray(part, dtype=np.int64) for part in parts]
    found = np.empty(len(moves), dtype=np.int64)
    addresses = (part.ctypes.data for part in (*kept, found))
    own = _Listing(len(moves), len(returns), len(jumps), *addresses)
    return found if _run("places_listed", byref(own)) else None

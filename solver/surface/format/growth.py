"""Growth: in which order values are predicted, and from which known ones.

A *link* names a target and the places whose values predict it.  In each round all targets are predicted whose links
have nothing but known places; they are known in the next round.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ...arrays import Array, Booleans, Indices
from ...native import stored
from ...native.library import reason_against
from ..container import demand
from .entropy import CONTEXTS, NumberReader, NumberWriter, whole_numbers

Places = NDArray[np.int64] | NDArray[np.int32]


class Coder(Protocol):
    """Turns predictions into values: prediction + step * whole number."""

    sizes: Array
    """How far values were from their predictions, (N, d)."""

    def __call__(self, places: Indices, predicted: Array, steps: Array, expected: Array) -> Array:
        """Return the values at places (n,).

        Parameters
        ----------
        predicted, steps
            (n, d) and (n, d) or (n, 1).
        expected
            How far off predictions may be, (n, d); says which table a number has.
        """


BOUNDS = 1.01 * 2.0 ** (np.arange(1, CONTEXTS) / 2.0) - 1.0
"""Two tables for each doubling.  No bound is a number that a mean of whole numbers can be, lest rounding decides."""


def contexts_of(expected: Array, steps: Array) -> Indices:
    """Table of each number, (n, d), by how large it is expected to be."""
    return np.searchsorted(BOUNDS, expected / steps)


class Writing:
    """Finds the whole numbers that lead from predictions to the given values, as nearly as the steps permit."""

    def __init__(self, values: Array) -> None:
        self._values, self.sizes, self.numbers = values, np.zeros(values.shape), NumberWriter()

    def __call__(self, places: Indices, predicted: Array, steps: Array, expected: Array) -> Array:
        """Return the nearest values; raises `TooLargeError` where a step is too small for them."""
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            found = whole_numbers((self._values[places] - predicted) / steps)
        self.numbers.add(found.ravel(), contexts_of(expected, steps).ravel())
        self.sizes[places] = np.abs(found) * steps
        return predicted + found * steps


class Reading:
    """Adds the stored whole numbers to the predictions; refuses what becomes larger than `largest`.

    `values` does the same for many rounds at once, where there is the compiled kernel.
    """

    def __init__(self, numbers: NumberReader, shape: tuple[int, int], largest: float) -> None:
        self.numbers, self.sizes, self._largest = numbers, np.zeros(shape), largest
        self.values = None if reason_against() else numbers.values(BOUNDS, largest)

    def __call__(self, places: Indices, predicted: Array, steps: Array, expected: Array) -> Array:
        """Return the stored values."""
        found = self.numbers.take(contexts_of(expected, steps).ravel()).reshape(predicted.shape)
        moves = found * steps
        self.sizes[places] = np.abs(moves)
        values = predicted + moves
        demand((np.abs(values) <= self._largest).all(), "a value is too large")
        return values


def rounds(targets: Places, sources: Places, known: Booleans) -> Iterator[tuple[Indices, Indices, Indices]]:
    """Go through places in the order in which they become known.

    Parameters
    ----------
    targets, sources
        The links, (Q,) and (Q, n).
    known
        Places that are known at the start, (N,); at the end those that are known then.

    Returns
    -------
    An iterator over `places, links, owner`
        Places that become known together, ascending; the links that predict them, and the position among the places of
        the target of each.
    """
    return _rounds(targets, sources, known) if reason_against() else stored.rounds(targets, sources, known)


def _rounds(targets: Places, sources: Places, known: Booleans) -> Iterator[tuple[Indices, Indices, Indices]]:
    count, width = sources.shape
    ones, bounds = np.ones(count * width, dtype=np.int8), np.arange(0, count * width + 1, width)
    from_source = csr_array((ones, sources.ravel(), bounds), shape=(count, len(known))).tocsc()
    starts, links_of = from_source.indptr, from_source.indices
    at_link, at_place = np.zeros(count, dtype=bool), np.zeros(len(known), dtype=bool)
    position = np.zeros(len(known), dtype=np.int64)
    fresh, columns = np.flatnonzero(known), [np.ascontiguousarray(column) for column in sources.T]
    while len(fresh):
        lengths = starts[fresh + 1] - starts[fresh]
        ends = np.cumsum(lengths)
        touched = links_of[np.repeat(starts[fresh] - (ends - lengths), lengths) + np.arange(ends[-1])]
        touched = touched[~known[targets[touched]]]
        for column in columns:
            touched = touched[known[column[touched]]]
        ready = _each_once(touched, at_link)
        places = _each_once(targets[ready], at_place)
        position[places] = np.arange(len(places))
        if len(places):
            yield places, ready, position[targets[ready]]
        known[places] = True
        fresh = places


def _each_once(numbers: Places, marks: Booleans) -> Indices:
    """Return the numbers, each once, ascending; `marks` are all false, and stay so.  (Faster than sorting them.)"""
    marks[numbers] = True
    found = np.flatnonzero(marks)
    marks[found] = False
    return found


def mean_of(values: Array, owner: Indices, count: int) -> Array:
    """Mean of the rows of values, (q, d), that each of `count` owners has."""
    each = np.bincount(owner, minlength=count)
    return np.stack([np.bincount(owner, weights=column, minlength=count) / each for column in values.T], axis=1)

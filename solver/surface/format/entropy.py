"""Whole numbers as few bits, each with the table of its context: asymmetric numeral systems in lanes (rANS).

A number is folded (0, -1, 1, -2 ... are 0, 1, 2, 3 ...) and split into a symbol and plain bits: below 4 the symbol is
the number; beyond it says how many bits the number has and the one behind the first.  Number i belongs to the lane
i modulo their count, so that NumPy decodes a number of each lane at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Indices
from ...native.library import reason_against
from ...native.reading import REFUSALS, StoredValues
from ...native.stored import StoredNumbers
from ..container import demand
from .blocks import BlockReader, BlockWriter

SCALE_BITS, WORD_BITS = 12, 16
SCALE, LOWEST = 1 << SCALE_BITS, 1 << WORD_BITS
TABLE_BITS = 3
"""Leading bits of a table's frequencies that are kept: a file stores its tables in less, and numbers hardly in more."""

CONTEXTS, SYMBOLS = 24, 96
"""Most tables, and symbols of a table: numbers have up to 47 bits."""

LARGEST = 2.0**46
"""A number lies strictly between this and its negative."""

MOST_LANES = 256
NUMBERS_OF_A_LANE = 6000


class TooLargeError(ArithmeticError):
    """A number has more bits than a table has symbols for."""


def whole_numbers(values: Array) -> Indices:
    """Return the nearest whole numbers.

    Raises
    ------
    TooLargeError
        When one is not below `LARGEST`, or not a number.
    """
    if not (np.abs(values) < LARGEST - 1.0).all():
        raise TooLargeError("a number of more than 47 bits")
    return np.rint(values).astype(np.int64)


def split(numbers: Indices) -> tuple[Indices, Indices, Indices]:
    """Return symbol, number of plain bits, and these bits."""
    folded = (numbers << 1) ^ (numbers >> 63)
    top = np.frexp(np.maximum(folded, 1).astype(np.float64))[1].astype(np.int64) - 1  # exact below 2^53
    small = folded < 4
    bits = np.where(small, 0, top - 1)
    symbol = np.where(small, folded, 2 * top + ((folded >> bits) & 1))
    return symbol, bits, folded & ((np.int64(1) << bits) - 1)


def joined(symbol: Indices, bits: Indices, plain: Indices) -> Indices:
    """Return the numbers that `split` split."""
    folded = np.where(symbol < 4, symbol, (((2 + (symbol & 1)) << bits) | plain))
    return (folded >> 1) ^ -(folded & 1)


def plain_bits(symbol: Indices) -> Indices:
    """Return how many plain bits follow a symbol."""
    return np.where(symbol < 4, 0, (symbol >> 1) - 1)


class NumberWriter:
    """Collects numbers with their contexts."""

    def __init__(self) -> None:
        self._numbers: list[Indices] = []
        self._contexts: list[Indices] = []

    def add(self, numbers: Indices, contexts: Indices) -> None:
        """Add numbers (n,) with contexts (n,) below `CONTEXTS`."""
        self._numbers.append(numbers)
        self._contexts.append(contexts)

    def finish(self, blocks: BlockWriter, name: str) -> None:
        """Put what was added into blocks."""
        none = [np.zeros(0, dtype=np.int64)]
        numbers, contexts = np.concatenate(none + self._numbers), np.concatenate(none + self._contexts)
        symbol, bits, plain = split(numbers)
        counts = np.bincount(contexts * SYMBOLS + symbol, minlength=CONTEXTS * SYMBOLS).reshape(CONTEXTS, SYMBOLS)
        table = _scaled(counts)
        lanes = max(min(MOST_LANES, len(numbers) // NUMBERS_OF_A_LANE), 1)
        states, words = _encoded(symbol, contexts, table, lanes)
        used = int(np.flatnonzero(table.sum(axis=0)).max(initial=-1)) + 1
        blocks.whole(f"{name}_lanes", np.array([lanes, used]))
        blocks.whole(f"{name}_table", table[:, :used].T)
        blocks.whole(f"{name}_states", states)
        blocks.raw(f"{name}_words", words.astype("<u2"))
        blocks.raw(f"{name}_bits", _packed(bits, plain))


def _scaled(counts: Indices) -> Indices:
    """Scale each row with a sum to the sum `SCALE`, and keep what is there above zero."""
    table = np.zeros_like(counts)
    for row, own in zip(table, counts, strict=True):
        if not own.any():
            continue
        fraction, exponent = np.frexp(np.maximum(own * SCALE // own.sum(), 1))
        rounded = np.ldexp(np.rint(np.ldexp(fraction, TABLE_BITS)), exponent - TABLE_BITS)
        row[:] = np.where(own > 0, np.maximum(rounded, 1), 0)
        while row.sum() != SCALE:
            largest = row.argmax()
            row[largest] = max(row[largest] + SCALE - row.sum(), row[largest] // 2 + 1)
    return table


def _encoded(symbol: Indices, contexts: Indices, table: Indices, lanes: int) -> tuple[Indices, NDArray[np.uint64]]:
    states = np.full(lanes, LOWEST, dtype=np.uint64)
    starts = np.cumsum(table, axis=1) - table
    frequency, start = (part[contexts, symbol].astype(np.uint64) for part in (table, starts))
    words: list[NDArray[np.uint64]] = []
    for first in range((len(symbol) - 1) // lanes * lanes, -1, -lanes):
        own, low = frequency[first : first + lanes], start[first : first + lanes]
        state = states[: len(own)]
        full = state >= own << np.uint64(2 * WORD_BITS - SCALE_BITS)
        words.append((state[full] & np.uint64(LOWEST - 1))[::-1])
        state = np.where(full, state >> np.uint64(WORD_BITS), state)
        states[: len(own)] = (state // own << np.uint64(SCALE_BITS)) + state % own + low
    joined_words = np.concatenate(words)[::-1] if words else np.zeros(0, dtype=np.uint64)
    return states.astype(np.int64), joined_words


def _packed(bits: Indices, plain: Indices) -> NDArray[np.uint8]:
    ends = np.cumsum(bits)
    flat = np.zeros(int(ends[-1]) if len(ends) else 0, dtype=np.uint8)
    for k in range(int(bits.max(initial=0))):
        some = np.flatnonzero(bits > k)
        flat[ends[some] - bits[some] + k] = (plain[some] >> k) & 1
    return np.packbits(flat, bitorder="little")


class NumberReader:
    """Returns the numbers in the order in which they were added, given their contexts.

    Parameters
    ----------
    blocks, name
        Where `NumberWriter.finish` put them.
    most
        How many numbers there can be.
    """

    def __init__(self, blocks: BlockReader, name: str, most: int) -> None:
        lanes, used = (int(number) for number in blocks.whole(f"{name}_lanes", 2))
        demand(1 <= lanes <= MOST_LANES and 0 <= used <= SYMBOLS, f"{name} has a wrong table")
        table = blocks.whole(f"{name}_table", used, CONTEXTS).T
        sums = table.sum(axis=1)
        demand((table >= 0).all() and ((sums == SCALE) | (sums == 0)).all(), f"{name} has a wrong table")
        self._known = sums > 0
        self._symbol = np.zeros((CONTEXTS, SCALE), dtype=np.uint8)
        for row, own in zip(self._symbol, table, strict=True):
            if own.any():
                row[:] = np.repeat(np.arange(used), own)
        self._frequency, self._start = table.astype(np.uint64), (np.cumsum(table, axis=1) - table).astype(np.uint64)
        self._states = blocks.whole(f"{name}_states", lanes).astype(np.uint64)
        words = blocks.raw(f"{name}_words", "<u2", 4 * most + 1)
        self._words = np.concatenate([words, np.zeros(lanes, dtype="<u2")]).astype(np.uint64)
        bits = blocks.raw(f"{name}_bits", "|u1", 6 * most + 1)
        self._bits = np.concatenate([bits, np.zeros(16, dtype=np.uint8)])
        self._at, self._word, self._bit, self._name = 0, 0, 0, name
        self._native = None
        if not reason_against():
            tables = self._symbol, self._frequency, self._start
            self._native = StoredNumbers(*tables, self._states, self._words, self._bits)

    def values(self, bounds: Array, largest: float) -> StoredValues | None:
        """What reads values up to `largest` by these numbers, if the compiled kernel does; `bounds` are of contexts."""
        return StoredValues(self._native, self._known, bounds, largest) if self._native else None

    def demand_read(self, status: int) -> None:
        """Refuse what `StoredValues` returned, unless it is 0."""
        demand(not status, REFUSALS.get(status, "").format(self._name))

    def take(self, contexts: Indices) -> Indices:
        """Return the next numbers, (n,), for contexts (n,)."""
        demand(self._known[contexts].all(), f"{self._name} has a wrong table")
        found = self._take(contexts) if self._native is None else self._native.take(contexts)
        demand(found is not None, f"{self._name} is cut")
        assert found is not None
        return found

    def _take(self, contexts: Indices) -> Indices:
        symbol, lanes, done = np.empty(len(contexts), dtype=np.int64), len(self._states), 0
        while done < len(contexts):
            lane = (self._at + done) % lanes
            end = min(done + lanes - lane, len(contexts))
            symbol[done:end] = self._step(slice(lane, lane + end - done), contexts[done:end])
            done = end
        self._at += len(contexts)
        bits = plain_bits(symbol)
        ends = self._bit + np.cumsum(bits)
        self._bit = int(ends[-1]) if len(ends) else self._bit
        demand(self._bit <= 8 * (len(self._bits) - 16), f"{self._name} is cut")
        places = ends - bits
        windows = np.lib.stride_tricks.sliding_window_view(self._bits, 8)[places >> 3]
        plain = windows.copy().view("<u8").ravel() >> (places & 7).astype(np.uint64)
        return joined(symbol, bits, plain.astype(np.int64) & ((np.int64(1) << bits) - 1))

    def _step(self, lanes: slice, contexts: Indices) -> Indices:
        state = self._states[lanes]
        slot = state & np.uint64(SCALE - 1)
        symbol = self._symbol[contexts, slot.astype(np.int64)].astype(np.int64)
        state = (
            self._frequency[contexts, symbol] * (state >> np.uint64(SCALE_BITS)) + slot - self._start[contexts, symbol]
        )
        empty = np.flatnonzero(state < LOWEST)
        words = self._words[self._word : self._word + len(empty)]
        demand(len(words) == len(empty), f"{self._name} is cut")
        state[empty] = (state[empty] << np.uint64(WORD_BITS)) | words
        self._word += len(empty)
        self._states[lanes] = state
        return symbol

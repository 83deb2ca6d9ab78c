"""Rounding that balances: where the domain of one patch moves the surface, that of the next moves it back.

Several patches hold a vertex.  Their domains are rounded one after the other, and each is rounded near the place

    u + argmin_d |e + w J d|^2 + (PULL s |J| d)^2 / 2,

with e how far the surface has moved at the vertex so far, w the patch's weight, J its derivative, and s the share that
its step is made for.  So what is left is the rounding of the last, not the sum of all, and steps can be longer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Indices
from .entropy import whole_numbers
from .growth import Writing, contexts_of

PULL = 0.7
"""How much a domain resists being moved where its patch has little weight."""

FARTHEST = 2.0
"""Steps that a domain is moved at most."""


@dataclass(frozen=True)
class Leverage:
    """How the surface at a vertex follows the domain of each patch vertex there.

    Attributes
    ----------
    vertices
        Vertex of each patch vertex, (M,).
    slopes
        Weight times derivative, scene units, (M, r, 2).
    resistance
        What is added to the diagonal of J'J, (M,).
    """

    vertices: Indices
    slopes: Array
    resistance: Array

    @classmethod
    def of(cls, vertices: Indices, derivative: Array, weights: Array, shares: Array) -> Leverage:
        """Weigh derivatives (M, r, 2), scene units, of patches with some weights and shares, (M,)."""
        steepness = (derivative**2).sum(axis=(1, 2)) / 2.0
        resistance = (PULL * shares) ** 2 * steepness + np.finfo(float).tiny
        return cls(vertices, derivative * weights[:, None, None], resistance)


class BalancedWriting(Writing):
    """Finds whole numbers as `Writing` does, for values that have been moved against what was rounded before.

    Parameters
    ----------
    values
        Domains, (M, 2).
    leverage
        What they do.
    moved
        How far each vertex has moved, (V, r), scene units; changed in place.
    """

    def __init__(self, values: Array, leverage: Leverage, moved: Array) -> None:
        super().__init__(values)
        self._leverage, self._moved = leverage, moved

    def __call__(self, places: Indices, predicted: Array, steps: Array, expected: Array) -> Array:
        """Return the values nearest to the moved ones; raises `TooLargeError` where a step is too small for them."""
        steps = np.broadcast_to(steps, predicted.shape)
        numbers = np.zeros(predicted.shape, dtype=np.int64)
        for rows in _one_after_the_other(self._leverage.vertices[places]):
            some = places[rows]
            vertices, slopes = self._leverage.vertices[some], self._leverage.slopes[some]
            wish = _against(self._moved[vertices], slopes, self._leverage.resistance[some])
            wish = np.clip(wish, -FARTHEST * steps[rows], FARTHEST * steps[rows]) + self._values[some]
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                numbers[rows] = whole_numbers((wish - predicted[rows]) / steps[rows])
            off = predicted[rows] + numbers[rows] * steps[rows] - self._values[some]
            self._moved[vertices] += np.einsum("nra,na->nr", slopes, off)
        self.numbers.add(numbers.ravel(), contexts_of(expected, steps).ravel())
        self.sizes[places] = np.abs(numbers) * steps
        return predicted + numbers * steps


def _one_after_the_other(vertices: Indices) -> list[Indices]:
    """Return rows (n,) such that each part names a vertex once, in the order in which they come."""
    order = np.argsort(vertices, kind="stable")
    place = np.arange(len(order))
    fresh = np.diff(vertices[order], prepend=-1) != 0
    rank = place - np.maximum.accumulate(np.where(fresh, place, 0))
    return [np.sort(order[rank == k]) for k in range(int(rank.max(initial=-1)) + 1)]


def _against(moved: Array, slopes: Array, resistance: Array) -> Array:
    """Solve (J'J + resistance) d = -J' moved for each of n, (n, 2)."""
    uu, vv = (np.einsum("nr,nr->n", slopes[:, :, k], slopes[:, :, k]) + resistance for k in (0, 1))
    uv = np.einsum("nr,nr->n", slopes[:, :, 0], slopes[:, :, 1])
    u, v = np.einsum("nra,nr->an", slopes, moved)
    with np.errstate(all="ignore"):
        found = -np.stack([vv * u - uv * v, uu * v - uv * u], axis=1) / (uu * vv - uv * uv)[:, None]
    return np.where(np.isfinite(found), found, 0.0)

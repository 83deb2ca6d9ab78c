"""Domains, predicted from the functions: a vertex lies where its patch's surface comes nearest to it.

Rounds grow from a triangle at each patch's centre.  A triangle with two known corners suggests where the third lies:
it has the same shape as in space.  From the mean of what is suggested one Gauss-Newton step leads towards the point of
the patch's surface that is nearest to the vertex; what neighbours were off by is expected here too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Booleans, Indices, any_of, rows_at
from ...fitting.dictionary import Dictionary
from ...native.domains import Damping, SparsePatches
from ...native.library import reason_against
from ...native.predicted import UnfoldedTriangles
from ...native.reading import DomainLimits
from ...native.stored_cover import shares_nearby
from .cover import Cover
from .growth import Coder, Reading, mean_of, rounds

DAMPING = Damping(share=1e-3, longest=0.1, far=0.02)
EXPECTED = 0.5

LARGEST_START = 1e4
ANYWHERE = 1.0
"""How far off a domain may be that no neighbour predicts."""

LEAST_SPEED, LARGEST_SPEED = 0.3, 1e9
LIMITS = DomainLimits(EXPECTED, LARGEST_START, ANYWHERE, LEAST_SPEED, LARGEST_SPEED)
FINER = 1 / 4
"""Steps of vertices whose rounding would move the surface too far."""


@dataclass(frozen=True)
class Shapes:
    """Where the third corner of each triangle lies, seen from the other two: along their edge and off it, (3, T) both.

    In row k the third corner is corner (k + 3) % 3; lengths are those of the edge.
    """

    share: Array
    height: Array

    @classmethod
    def of(cls, positions: Array, triangles: Indices) -> Shapes:
        """Measure triangles (T, 3) between positions (V, 3)."""
        corner = [[axis.take(column) for axis in positions.T.copy()] for column in triangles.T]
        share, height = np.empty((3, len(triangles))), np.empty((3, len(triangles)))
        for row in range(3):
            (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (corner[(k + row + 1) % 3] for k in range(3))
            x, y, z, u, v, w = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
            length = np.maximum(x * x + y * y + z * z, np.finfo(float).tiny)
            share[row] = (x * u + y * v + z * w) / length
            height[row] = np.sqrt((y * w - z * v) ** 2 + (z * u - x * w) ** 2 + (x * v - y * u) ** 2) / length
        return cls(share, height)


@dataclass(frozen=True)
class Functions:
    """Sparse functions of K patches, of r coordinates: terms (r, n, K) as degrees in u and v, and coefficients.

    `coefficients` are zero where a coordinate uses fewer functions.  `compiled` are the same for the kernel, if it is
    there.
    """

    dictionary: Dictionary
    degrees: Indices
    coefficients: Array
    compiled: SparsePatches | None

    @classmethod
    def of(cls, dictionary: Dictionary, support: Indices, coefficients: Array) -> Functions:
        """Take the functions `support` with their coefficients, (K, r, n) both."""
        used = support >= 0
        degrees, factors = dictionary.degrees[np.where(used, support, 0)], np.where(used, coefficients, 0.0)
        compiled = None
        if reason_against() is None:
            compiled = SparsePatches(degrees, factors, dictionary.degree, dictionary.basis == "legendre")
        return cls(
            dictionary,
            np.ascontiguousarray(degrees.transpose(3, 1, 2, 0)),
            np.ascontiguousarray(factors.transpose(1, 2, 0)),
            compiled,
        )

    def __call__(self, patch: Indices, domain: Array) -> tuple[Array, Array, Array]:
        """Values and derivatives along u and v, (r, n) each, of patches (n,) at parameters (n, 2)."""
        u, v = (self.dictionary.tables(parameter) for parameter in np.ascontiguousarray(domain.T))
        du, dv = self.dictionary.derivative_tables(u), self.dictionary.derivative_tables(v)
        point = np.arange(len(patch))
        # flat places in the tables: NumPy finds these in less time than pairs of places
        i, j = (degree.take(patch, axis=-1) * len(patch) + point for degree in self.degrees)
        factors = self.coefficients.take(patch, axis=-1)
        u, v, du, dv = (np.ascontiguousarray(table).ravel() for table in (u, v, du, dv))
        at_u, at_v = u.take(i), v.take(j)
        at_v *= factors
        along_v = dv.take(j)
        along_v *= factors
        return (
            np.einsum("rsn,rsn->rn", at_u, at_v),
            np.einsum("rsn,rsn->rn", du.take(i), at_v),
            np.einsum("rsn,rsn->rn", at_u, along_v),
        )

    def nearer(self, patch: Indices, domain: Array, target: Array) -> tuple[Array, Array]:
        """Step from parameters (n, 2) towards the points nearest to targets (n, r): once, or twice if it is far.

        Returns
        -------
        The new parameters, and how fast the functions move with each where the last step began, (n, 2) both.
        """
        if self.compiled is not None:
            return self.compiled.nearer(patch, domain, target, DAMPING)
        nearest, speed = self._step(patch, domain, target)
        far = np.flatnonzero((np.abs(nearest - domain) > DAMPING.far).any(axis=1))
        nearest[far], speed[far] = self._step(patch[far], nearest[far], target[far])
        return nearest, speed

    def _step(self, patch: Indices, domain: Array, target: Array) -> tuple[Array, Array]:
        """Make one damped Gauss-Newton step; return the new parameters and the speeds, (n, 2) both."""
        with np.errstate(all="ignore"):  # forged functions may overflow; their steps are cut off
            value, u, v = self(patch, domain)
            missing = target.T - value
            uu, uv, vv = (u * u).sum(axis=0), (u * v).sum(axis=0), (v * v).sum(axis=0)
            ue, ve = (u * missing).sum(axis=0), (v * missing).sum(axis=0)
            speed = np.sqrt(np.stack([uu, vv], axis=1))
            damping = DAMPING.share * (uu + vv) + np.finfo(float).tiny
            uu, vv = uu + damping, vv + damping
            step = np.stack([vv * ue - uv * ve, uu * ve - uv * ue], axis=1) / (uu * vv - uv * uv)[:, None]
        step = np.where(np.isfinite(step), step, 0.0)
        return domain + np.clip(step, -DAMPING.longest, DAMPING.longest), speed


def code_domains(
    cover: Cover, centres: Indices, shapes: Shapes, target: Array, functions: Functions, steps: Array, code: Coder
) -> Array:
    """Find a domain, (M, 2): what `code` makes of the predictions.

    Parameters
    ----------
    cover, centres
        The patches, and the node at the centre of each, (K,), or -1.
    shapes
        Of the mesh's triangles.
    target
        The patch vertices' positions in the patches' frames, as far as `functions` describe them, (M, r).
    steps
        Largest move of each patch vertex by one step, in the patches' frames, (M,).
    """
    patch = cover.patch_of_vertex
    known = seeds_of(cover, centres)
    unfolded = None
    if not reason_against():
        unfolded = UnfoldedTriangles(cover.corners, cover.mesh_triangles, shapes.share, shapes.height)
    if unfolded and functions.compiled and isinstance(code, Reading) and code.values:
        given = unfolded, functions.compiled, DAMPING, LIMITS, known, target, steps, cover.vertex_offsets
        status, found = code.values.domains(*given)
        code.numbers.demand_read(status)
        return found
    domain, off = np.zeros((len(patch), 2)), np.zeros((len(patch), 2))
    # each corner of each triangle is predicted from the two that follow
    corners = np.ascontiguousarray(cover.corners.T)
    one, two = (np.roll(corners, -k, axis=0).ravel() for k in (1, 2))
    means = unfolded.means if unfolded else _suggestions(cover, shapes, one, two)

    def settle(places: Indices, start: Array, expected: Array, size: Array) -> None:
        start = np.where(np.abs(start) <= LARGEST_START, start, 0.0)  # collapsed triangles suggest anything
        nearest, speed = functions.nearer(patch[places], start, target[places])
        speed = np.clip(np.where(np.isfinite(speed), speed, LARGEST_SPEED), LEAST_SPEED, LARGEST_SPEED)
        step = steps[places, None] / speed
        domain[places] = code(places, nearest + EXPECTED * expected, step, size)
        off[places] = domain[places] - nearest

    def settle_unpredicted(places: Indices) -> None:
        nothing = np.zeros((len(places), 2))
        settle(places, nothing, nothing, nothing + ANYWHERE)

    settle_unpredicted(np.flatnonzero(known))
    for places, used, owner in rounds(corners.ravel(), np.stack([one, two], axis=1), known):
        mean = means(domain, off, code.sizes, used, owner, len(places))
        settle(places, mean[:, :2], mean[:, 2:4], np.repeat(mean[:, 4:], 2, axis=1))
    settle_unpredicted(np.flatnonzero(~known))
    return domain


def _suggestions(cover: Cover, shapes: Shapes, one: Indices, two: Indices) -> Callable[..., Array]:
    """Return what finds the means of what links from the patch vertices `one` and `two`, (3 S,), suggest."""
    share, height = (part[:, cover.mesh_triangles].ravel() for part in (shapes.share, shapes.height))

    def means(domain: Array, off: Array, sizes: Array, used: Indices, owner: Indices, count: int) -> Array:
        a, b = one[used], two[used]
        start = domain[a]
        along = domain[b] - start
        turned = along[:, ::-1] * (-1.0, 1.0)
        suggested = start + share[used, None] * along + height[used, None] * turned
        size = (sizes[a] + sizes[b]).mean(axis=1, keepdims=True) / 2.0
        return mean_of(np.concatenate([suggested, (off[a] + off[b]) / 2.0, size], axis=1), owner, count)

    return means


def shares_of(cover: Cover, weights: Array, least: float) -> Array:
    """How much of a patch vertex's move shows, (M,): its weight, half of a neighbour's, or `least`; the largest."""
    if not reason_against():
        return np.maximum(shares_nearby(weights, cover.corners), least)
    largest = weights[cover.corners].max(axis=1, initial=0.0)
    shares = weights.copy()
    np.maximum.at(shares, cover.corners.ravel(), np.repeat(largest / 2.0, 3))
    return np.maximum(shares, least)


def seeds_of(cover: Cover, centres: Indices) -> Booleans:
    """Tell which patch vertices, (M,), rounds start from: the corners of a patch's first triangle at its centre."""
    starts, is_centre = cover.triangle_offsets[:-1], cover.nodes == np.repeat(centres, np.diff(cover.vertex_offsets))
    at_centre = np.flatnonzero(any_of(rows_at(is_centre, cover.corners)))
    patch, own = np.unique(np.searchsorted(starts, at_centre, side="right") - 1, return_index=True)
    first = starts.copy()
    first[patch] = at_centre[own]
    first = first[np.diff(cover.triangle_offsets) > 0]
    seeds = np.zeros(len(cover.nodes), dtype=bool)
    seeds[cover.corners[first]] = True
    return seeds

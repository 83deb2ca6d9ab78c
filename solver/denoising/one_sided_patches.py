"""One-sided patches: quadratics over tangent planes, fitted robustly to the noisy positions on one side of a crease.

Each patch starts small and doubles while the larger fit moves the smaller one's surface by no more than the noise
does (in the spirit of Lepski's rule): flat sides are averaged over hundreds of triangles, fine relief over a dozen.
Triangles whose guiding normal the quadratic does not follow and vertices far off it lose their weight (Welsch), so
what reaches across a crease does not count.  Curvature that noise alone could have made is shrunk (James and Stein),
which turns the patches of a plane into planes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np

from ..arrays import Array, Booleans, Indices
from ..mesh.normals import unit
from ..mesh.quadrics import quadric_terms
from ..native.patch_growth import Listed
from .patch_growth import agreeing_neighbours, chunk_size, growth_on
from .patch_normals import bends_of_triangles, local_normals
from .seeds import signs
from .surface import Surface

TERMS = 6  # 1, u, v, u^2, u v, v^2
FEWEST_VERTICES = 8  # with fewer, or with less weight than theirs, a quadratic is meaningless

_RESIDUAL_WIDTH = 2.0  # noise levels
_RIM_TAPER = 0.7  # how much less a vertex at the rim weighs than one at the seed
_RIDGE = 1e-4
_SHRINKAGE = 1.5  # times the variance; k - 2 = 1 minimises the risk, k = 3 removes what noise gives on average
_INVARIANT = np.array([1.0, 1.0, 1.0, 1.0, 0.5, 1.0])  # a ridge that does not depend on the directions of u and v


@dataclass(frozen=True)
class PatchRule:
    """How patches are grown and weighted.

    Attributes
    ----------
    sizes
        Numbers of triangles, ascending: how large a patch is at most at each step of its growth.
    normal_width
        Distance of the guiding normal from the quadratic's at which a triangle's weight has fallen to exp(-1/2).
    largest_change
        How far a step of growth may move the smaller patch's surface: the squared moves of its vertices add up to
        at most this many squared noise levels.
    caution
        Factor of `largest_change` for each step that went before.  Where even noise moves less than that, on planes,
        patches become large; elsewhere the bias of a large patch would be as large as what it gains.
    misfit_power
        How strongly a patch loses weight whose residuals are larger than the noise.
    wide
        Share of the largest size from which on a patch lies on a wide smooth side.
    """

    sizes: tuple[int, ...]
    normal_width: float
    largest_change: float
    caution: float
    misfit_power: float
    wide: float = 0.6

    def larger(self, factor: float) -> PatchRule:
        """Return the rule for patches with `factor` times as many triangles."""
        return replace(self, sizes=tuple(round(size * factor) for size in self.sizes))

    def following(self, deviation: float) -> PatchRule:
        """Return the rule for a guide whose normals are off by at most so much along a tangent, if that is less."""
        return replace(self, normal_width=min(self.normal_width, deviation))

    @property
    def least_cosine_across(self) -> float:
        """Of the angle between the normals of neighbours that join."""
        return float(np.cos(np.clip(2.5 * self.normal_width, 0.35, 1.2)))

    @property
    def least_cosine_from_seed(self) -> float:
        """Of the angle between a triangle's normal and the seed's."""
        return float(np.cos(max(2.5 * self.normal_width, 0.7)))


@dataclass(frozen=True)
class Fits:
    """Fitted patches, P of them, padded to the largest: K triangles, L vertices; -1 marks padding.

    Attributes
    ----------
    triangles, vertices
        Members, (P, K) and (P, L).
    frames
        Columns: two tangents and the normal of the seed, (P, 3, 3).
    lengths
        Unit of u and v, (P,).
    coefficients
        Of 1, u, v, u^2, u v, v^2 for the height, (P, 6).
    gram
        Weighted products of the terms, (P, 6, 6).
    variance
        Covariance of the coefficients for noise of variance 1, (P, 6, 6).
    at_triangle, at_vertex
        (u, v) of the centroids, (P, 2, K), and of the vertices, (P, 2, L).
    corners
        The triangles' corners from their centroids, in (u, v), (P, 2, 3, K).
    triangle_weights
        How well the quadratic follows the guiding normals, (P, K), zero on padding.
    vertex_weights
        Weights in [0, 1], (P, L), zero on padding.
    residuals
        Heights of the vertices above the quadratic, (P, L).
    responses
        Heights of the quadratic at the vertices, (P, L), if the vertices' were `signs` and all weights the same.
    misfit
        Mean squared residual over that of the noise, (P,).
    sound
        Patches with enough vertices to be meaningful, (P,).
    """

    triangles: Indices
    vertices: Indices
    frames: Array
    lengths: Array
    coefficients: Array
    gram: Array
    variance: Array
    at_triangle: Array
    at_vertex: Array
    corners: Array
    triangle_weights: Array
    vertex_weights: Array
    residuals: Array
    responses: Array
    misfit: Array
    sound: Booleans

    def select(self, which: Indices) -> Fits:
        """Return some of the patches, by their numbers in ascending order."""
        if len(which) == len(self):
            return self
        return Fits(**{item.name: getattr(self, item.name)[which] for item in fields(self)})

    def __len__(self) -> int:
        return len(self.triangles)

    def spread(self, at: Array) -> Array:
        """Return the variance of the heights at (u, v), (P, 2, N), for noise of variance 1, (P, N)."""
        terms = _terms(at)
        return np.maximum(np.einsum("pin,pin->pn", self.variance @ terms, terms), 1e-12)

    def normals_at_vertices(self) -> Array:
        """Return the quadratics' unit normals in space at the vertices, (P, L, 3)."""
        return self._in_space(local_normals(self.at_vertex, self.coefficients, self.lengths))

    def normals_of_triangles(self) -> Array:
        """Return the unit normals of the planes through the quadratics' points at the corners, (P, K, 3)."""
        bends = bends_of_triangles(self.corners, self.coefficients)
        return self._in_space(local_normals(self.at_triangle, self.coefficients, self.lengths, bends))

    def _in_space(self, normals: Array) -> Array:
        turned: Array = normals.transpose(0, 2, 1) @ self.frames.transpose(0, 2, 1)
        return turned


@dataclass(frozen=True)
class _Accepted:
    """Some of the patches of a fit; what belongs to all their vertices is copied only where it is asked for."""

    fits: Fits
    which: Indices

    def which_are(self, chosen: Booleans) -> _Accepted:
        """Return some of these, (P,)."""
        return _Accepted(self.fits, self.which[chosen])

    def copied(self) -> Fits:
        """Return these patches alone."""
        return self.fits.select(self.which)


class PatchFitter:
    """Grows and fits patches on one mesh with one set of guiding normals.

    Parameters
    ----------
    surface, vertices
        The mesh; noisy positions (V, 3).
    guide
        Guiding normals of the triangles, (T, 3).
    noise_level
        Standard deviation of the noise along the normals.
    rule
        How patches grow.
    """

    def __init__(self, surface: Surface, vertices: Array, guide: Array, noise_level: float, rule: PatchRule) -> None:
        self.chunk = chunk_size(max(len(surface.triangles), len(vertices)))
        self._vertices, self._guide, self._noise_level, self._rule = vertices, guide, noise_level, rule
        self._signs = signs(len(vertices))
        corners = vertices[surface.triangles]
        self._centroids = corners.mean(axis=1)
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        self._unit_length = np.maximum(3 * sides.mean(axis=1), 1e-300)
        neighbours = agreeing_neighbours(surface.neighbours, guide, rule.least_cosine_across)
        limits = rule.least_cosine_from_seed, self.chunk, rule.sizes[-1]
        self._growing = growth_on(surface.triangles, len(vertices), neighbours, guide, *limits)

    def fits(self, seeds: Indices) -> Iterator[Fits]:
        """Yield the patches of at most `chunk` seeds, each at the largest size that the rule lets it have."""
        rule = self._rule
        growing = self._growing
        growing.begin(seeds)
        active = np.ones(len(seeds), dtype=bool)
        frames = _frames(self._guide[seeds])
        accepted: list[_Accepted] = []
        before = np.zeros_like(growing.sizes)
        for limit in rule.sizes:
            growing.grow(limit, active)
            grown = active & (growing.sizes > before)
            if not grown.any():
                break
            fits = self._fit(seeds[grown], frames[grown], growing.listed(grown))
            fitted = better = grown[active]
            if accepted:
                better = fitted.copy()
                better[fitted] = self._agrees(fits, [smaller.which_are(fitted) for smaller in accepted])
                yield accepted[-1].which_are(~better).copied()
                accepted = [smaller.which_are(better) for smaller in accepted]
            active[active] = better
            accepted.append(_Accepted(fits, better[fitted].nonzero()[0]))
            before = growing.sizes.copy()
            if not active.any():
                break
        yield accepted[-1].copied()

    def _agrees(self, larger: Fits, accepted: list[_Accepted]) -> Booleans:
        """Return whether a larger fit moves none of the surfaces of its smaller ones by more than noise may, (P,)."""
        agrees = np.ones(len(larger), dtype=bool)
        largest = self._rule.largest_change * self._rule.caution ** len(accepted)
        for steps, smaller in enumerate(reversed(accepted), start=1):
            fits, which = smaller.fits, smaller.which
            change = larger.coefficients - fits.coefficients[which]
            moved = np.einsum("pi,pij,pj->p", change, fits.gram[which], change) / self._noise_level**2
            # Of the smaller fit's variance the larger one, 2^steps times its size, keeps the part 1 / 2^steps.
            allowed = largest * 2 * (1 - 0.5**steps)
            agrees &= (moved < allowed) | ~fits.sound[which]
        return agrees

    def _fit(self, seeds: Indices, frames: Array, members: Listed) -> Fits:
        """Fit patches as they have grown: weights from the guide first, then from the fit itself."""
        triangles, vertices, corner_places = members
        lengths = self._unit_length[seeds]
        at_vertex, heights = self._local(vertices, self._vertices, seeds, frames)
        present = triangles >= 0
        corners = _at_corners(at_vertex, corner_places, present)
        at_triangle = corners.mean(axis=2)
        guide = (self._guide[triangles] @ frames).transpose(0, 2, 1)
        terms = _terms(at_vertex)
        taper, ridge = _taper_and_ridge(at_vertex, vertices >= 0)

        def weights(triangle_weights: Array, vertex_weights: Array) -> Array:
            """A vertex counts as much as the triangles around it, and as itself."""
            each = np.repeat(triangle_weights[present], 3)
            pooled = np.bincount(corner_places, each, vertices.size).reshape(vertices.shape)
            return vertex_weights * pooled / np.maximum(pooled.max(axis=1, keepdims=True), 1e-300)

        def likeness(coefficients: Array) -> Array:
            return _welsch(local_normals(at_triangle, coefficients, lengths) - guide, self._rule.normal_width)

        upright = np.array([0.0, 0.0, 1.0])[:, None]
        first = weights(_welsch(guide - upright, max(0.35, 1.5 * self._rule.normal_width)), taper)
        coefficients = _least_squares(terms, first, heights, ridge)[0]
        residuals = heights - _values(terms, coefficients)
        near = _welsch(residuals[:, None], _RESIDUAL_WIDTH * self._noise_level)
        final = weights(likeness(coefficients), taper * near)
        coefficients, gram, regular = _least_squares(terms, final, heights, ridge)
        variance, response = _of_noise(terms, final, regular, self._signs[vertices])
        kept = kept_curvature(coefficients, variance * self._noise_level**2)
        coefficients = shrink_curvature(coefficients, regular, kept)
        residuals = heights - _values(terms, coefficients)
        effective, misfit = _quality(final, residuals / self._noise_level)
        return Fits(
            *(triangles, vertices, frames, lengths, coefficients, gram, variance),
            at_triangle=at_triangle,
            at_vertex=at_vertex,
            corners=corners - at_triangle[:, :, None],
            triangle_weights=likeness(coefficients) * present,
            vertex_weights=final,
            residuals=residuals,
            responses=_values(terms, shrink_curvature(response, regular, kept)),
            misfit=misfit,
            sound=effective >= FEWEST_VERTICES,
        )

    def _local(self, members: Indices, positions: Array, seeds: Indices, frames: Array) -> tuple[Array, Array]:
        """Return (u, v), (P, 2, N), and heights, (P, N), of the members in their patches' frames."""
        local = (positions[members] - self._centroids[seeds][:, None]) @ frames
        at = local[..., :2].transpose(0, 2, 1) / self._unit_length[seeds][:, None, None]
        return at, np.ascontiguousarray(local[..., 2])


def _terms(at: Array) -> Array:
    """Return the quadratic's terms at (u, v), (P, 2, N): (P, 6, N)."""
    return quadric_terms(at[:, 0], at[:, 1], axis=1)


def _at_corners(at_vertex: Array, corner_places: Indices, present: Booleans) -> Array:
    """Return (u, v) of the triangles' corners, (P, 2, 3, K), which stand at these places of the vertices; 0 if none."""
    corners = np.zeros((len(present), 2, 3, present.shape[1]))
    for corner in range(3):
        places = corner_places[corner::3]
        for axis in range(2):
            corners[:, axis, corner][present] = at_vertex[:, axis].ravel()[places]
    return corners


def _frames(normals: Array) -> Array:
    """Return matrices whose columns are two tangents and the normal, (P, 3, 3)."""
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = unit(np.cross(normals, axis))
    return np.stack((first, np.cross(normals, first), normals), axis=2)


def _taper_and_ridge(at: Array, present: Booleans) -> tuple[Array, Array]:
    """Return weights that fall towards the rim, (P, L), and a slight ridge that suits the patches' extents, (P, 6)."""
    distance = np.where(present, at[:, 0] ** 2 + at[:, 1] ** 2, 0.0)
    taper = present * (1 - _RIM_TAPER * distance / np.maximum(distance.max(axis=1), 1e-300)[:, None])
    extent = 0.5 * distance.sum(axis=1) / np.maximum(present.sum(axis=1), 1)
    orders = np.stack((np.full_like(extent, 1e-2), extent, extent, extent**2, extent**2, extent**2), axis=1)
    return taper, _RIDGE * _INVARIANT * orders


def _welsch(differences: Array, width: float) -> Array:
    """Robust weights from the lengths of differences, (P, d, N): (P, N)."""
    return np.exp(np.einsum("pdn,pdn->pn", differences, differences) / (-2 * width**2))


def _values(terms: Array, coefficients: Array) -> Array:
    values: Array = (coefficients[:, None] @ terms)[:, 0]
    return values


def _least_squares(terms: Array, weights: Array, heights: Array, ridge: Array) -> tuple[Array, Array, Array]:
    """Return the coefficients, (P, 6), and the Gram matrices without and with the ridge, (P, 6, 6)."""
    weighted = terms * weights[:, None]
    gram: Array = weighted @ terms.transpose(0, 2, 1)
    # The least total keeps patches without weight solvable; they are not sound.
    scale = np.maximum(weights.sum(axis=1), 1e-6)[:, None]
    regular = gram + (ridge * scale)[:, :, None] * np.eye(TERMS)
    solved = np.linalg.solve(regular, weighted @ heights[..., None])[..., 0]
    return np.asarray(solved, dtype=np.float64), gram, regular


def _of_noise(terms: Array, weights: Array, regular: Array, noise: Array) -> tuple[Array, Array]:
    """Return the coefficients' covariance for heights of variance 1, (P, 6, 6), and those of some, (P, L): (P, 6)."""
    weighted = terms * weights[:, None]
    inverse = np.asarray(np.linalg.inv(regular), dtype=np.float64)
    variance: Array = inverse @ (weighted @ weighted.transpose(0, 2, 1)) @ inverse
    return variance, (inverse @ (weighted @ noise[..., None]))[..., 0]


def kept_curvature(coefficients: Array, covariance: Array) -> Array:
    """Return which share of the second-order terms stays, (P,), without what noise alone explains of them."""
    curvature = coefficients[:, 3:]
    explained = np.linalg.solve(covariance[:, 3:, 3:] + 1e-300 * np.eye(3), curvature[..., None])[..., 0]
    significance = (curvature * explained).sum(axis=1)
    kept: Array = np.maximum(0.0, 1 - _SHRINKAGE / np.maximum(significance, 1e-300))
    return kept


def shrink_curvature(coefficients: Array, gram: Array, kept: Array) -> Array:
    """Keep a share, (P,), of the second-order terms; refit the others to that."""
    change = (kept - 1)[:, None] * coefficients[:, 3:]
    others = np.linalg.solve(gram[:, :3, :3], gram[:, :3, 3:] @ change[..., None])[..., 0]
    return coefficients + np.concatenate((-others, change), axis=1)


def _quality(weights: Array, residuals: Array) -> tuple[Array, Array]:
    """Return how many vertices the weights are worth, and the mean squared residual by degree of freedom, (P,)."""
    total = np.maximum(weights.sum(axis=1), 1e-300)
    effective = total**2 / np.maximum((weights**2).sum(axis=1), 1e-300)
    mean = (weights * residuals**2).sum(axis=1) / total
    return effective, mean / (1 - TERMS / np.maximum(effective, TERMS + 1))

"""The representation: everything that is needed to evaluate the surface anywhere."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, Booleans, Indices, any_of, rows_at, runs_of_rows
from ..fitting.dictionary import Dictionary, coefficient_grid, combine
from ..mesh.edges import stable_order
from ..mesh.normals import unit
from ..native import surface as native
from ..native.library import reason_against
from ..processes.each import Each
from .closing import ROUNDING, Closing, Fans
from .corners import corners_in_order, holders_of
from .flat import checked_places, flat_part
from .saved import Saved

POINTS_AT_ONCE = 2048
"""Points that a patch evaluates together; their tables stay in a processor's cache."""

COVER_ALONE = "fans", "corners", "patch_of_triangle", "shares", "input_weights", "holders"
"""What follows from triangles, patches and weights, not from positions or functions."""


@dataclass(frozen=True)
class Representation(Saved):
    """K patches over a mesh of V vertices, T triangles; M patch vertices and S patch triangles in ragged arrays.

    The surface at a point x of a triangle is S(x) = sum_k phi_k(x) h_k(Phi_k(x)) + (1 - sum_k phi_k(x)) x, the sum over
    the patches that contain the triangle (eqs. 1 and 6, section 4.2): h_k is a sparse polynomial, Phi_k maps the
    triangle linearly into the patch's optimised domain, and phi_k is linear on the triangle; `closing` is added.

    Attributes
    ----------
    vertices
        Input vertices, (V, 3), scene units.
    triangles, polygon
        Corners of the triangles (T, 3) and the input face that each lies in (T,).
    face_offsets, face_corners
        The input faces as ragged array of vertex numbers.
    vertex_offsets, patch_vertices
        Patch k has the mesh vertices `patch_vertices[vertex_offsets[k]:vertex_offsets[k + 1]]`.
    triangle_offsets, patch_triangles, mesh_triangles
        The patches' triangles: local vertex numbers (S, 3), and the mesh triangle that each is (S,).
    domains, initial_domains
        Optimised and initial domains in the patches' frames, (C, M, 2); C = 1, or 3 with one for each coordinate.
    weights
        Blending weights at the patches' vertices, (M,).
    blending
        "partition" or "uniform".
    origins, scales
        Frames: value = origin + h / scale, (K, 3) and (K, C).
    basis, degree
        The dictionary.
    support, coefficients
        Sparse coefficients of every patch and coordinate, (K, 3, s); support -1 where fewer are used.
    energy
        Objective of each patch after each iteration, in the patch's scale, (K, I); NaN where a patch took fewer.
    solver
        "native" or "numpy": what evaluates the surface, with differences of rounding.  Not stored.
    initial
        How the initial domains were made, and can be made again: "lscm", "harmonic", "tutte", or "" where unknown.
    creases
        Edges at which patches end and the surface has a crease, as pairs of vertices (C, 2), the smaller number first.
    """

    vertices: Array
    triangles: Indices
    polygon: Indices
    face_offsets: Indices
    face_corners: Indices
    vertex_offsets: Indices
    patch_vertices: Indices
    triangle_offsets: Indices
    patch_triangles: Indices
    mesh_triangles: Indices
    domains: Array
    initial_domains: Array
    weights: Array
    blending: str
    origins: Array
    scales: Array
    basis: str
    degree: int
    support: Indices
    coefficients: Array
    energy: Array
    solver: str = "native"
    initial: str = ""
    creases: Indices = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))

    @property
    def patches(self) -> int:
        """Number of patches, K."""
        return len(self.origins)

    def computed_cover(self) -> dict[str, Any]:
        """What has been computed of the cover, for `take_cover` of one over the same patches with the same weights."""
        return {name: own for name, own in vars(self).items() if name in COVER_ALONE}

    def take_cover(self, computed: dict[str, Any]) -> None:
        """Take what another representation has computed of the same cover."""
        vars(self).update(computed)

    def prepare(self, each: Each = map) -> None:
        """Compute what is kept for evaluating, before several threads ask for it; `each` computes parts of it."""
        _ = self.dictionary, self.input_weights, self.native_functions, self.native_blend, self.holders
        if len(self.creases):
            if "closing" not in vars(self):
                vars(self)["closing"] = self._closed(each)
            self.closing.prepare()

    @cached_property
    def dictionary(self) -> Dictionary:
        """The basis functions that `support` counts."""
        return Dictionary(self.degree, self.basis)

    @cached_property
    def fans(self) -> Fans:
        """The fans of triangles between creases."""
        return Fans.of(self.triangles, self.creases, len(self.vertices))

    @cached_property
    def closing(self) -> Closing:
        """What closes the surface along its creases."""
        return self._closed(map)

    def _closed(self, each: Each) -> Closing:
        def surface(face_index: Indices, barycentric: Array) -> tuple[Array, Array]:
            open_ = self._evaluate(face_index, barycentric, tangents=True, closed=False)
            return open_[:, 0], unit(np.asarray(np.cross(open_[:, 1], open_[:, 2]), dtype=np.float64))

        return Closing.of(self.fans, self.triangles, self.degree, surface, each)

    @cached_property
    def corners(self) -> NDArray[np.int32]:
        """Patch vertices, counted over all patches, at the corners of the patch triangles, (S, 3).

        In the order of the mesh triangle's corners: a patch turns triangles that are wound against its orientation.
        """
        vertices, triangles = (self.vertex_offsets, self.patch_vertices), (self.mesh_triangles, self.triangles)
        return corners_in_order(self.patch_triangles, vertices, self.triangle_offsets, *triangles)

    @cached_property
    def patch_of_triangle(self) -> Indices:
        """Patch of each patch triangle, (S,)."""
        return np.repeat(np.arange(self.patches), np.diff(self.triangle_offsets))

    def corner_weights(self, which: Indices | slice = slice(None)) -> Array:
        """Blending weight of patch triangles' patches at their corners, (n, 3): phi_k is linear between them.

        With uniform blending each triangle averages the patches that hold it, whatever other patches hold its corners.
        """
        return np.stack([self._weights_at(corner, which) for corner in range(3)], axis=1)

    def _weights_at(self, corner: int, which: Indices | slice = slice(None)) -> Array:
        weights = rows_at(self.weights, self.corners[which, corner])
        return weights if self.shares is None else (weights > 0.0) * self.shares[self.mesh_triangles[which]]

    @cached_property
    def shares(self) -> Array | None:
        """With uniform blending the weight of each patch on each mesh triangle, (T,)."""
        holders = np.bincount(self.mesh_triangles, minlength=len(self.triangles))
        return 1.0 / np.maximum(holders, 1) if self.blending == "uniform" else None

    @property
    def weighty(self) -> Booleans:
        """Which patch triangles have some weight, (S,)."""
        return any_of(rows_at(self.weights > 0.0, self.corners))

    @cached_property
    def holders(self) -> native.Holders:
        """The patch triangles with weight over each mesh triangle."""
        return holders_of(self.weighty, self.triangle_offsets, self.mesh_triangles, len(self.triangles))

    @cached_property
    def _corner_table(self) -> tuple[Array, Array]:
        """`corner_weights` and domains of the patch triangles with the points last, (3, S) and (3, 2, C, S)."""
        domains = self.domains[:, self.corners].transpose(2, 3, 0, 1)
        return np.ascontiguousarray(self.corner_weights().T), np.ascontiguousarray(domains)

    @cached_property
    def input_weights(self) -> Array:
        """Weight of the input itself at the triangles' corners, (T, 3): what the patches leave."""
        left = np.ones(self.triangles.shape)
        for corner, column in enumerate(left.T):
            column -= np.bincount(self.mesh_triangles, weights=self._weights_at(corner), minlength=len(left))
        left[left < ROUNDING] = 0.0
        return left

    @cached_property
    def native_functions(self) -> native.Functions | None:
        """The patches' functions as the compiled kernel takes them; None where NumPy evaluates them."""
        if self.solver != "native" or reason_against():
            return None
        own = self.support, self.coefficients, self.origins, self.scales, self.degree
        return native.Functions(*own, self.basis == "legendre")

    @cached_property
    def native_blend(self) -> native.Blend:
        """Where the patches lie and count, as the compiled kernel takes it."""
        weights = self.weights if self.shares is None else (self.weights > 0.0).astype(np.float64)
        triangles = self.triangle_offsets, self.mesh_triangles, self.corners
        return native.Blend(*triangles, weights, self.domains, self.shares)

    @cached_property
    def grids(self) -> Array:
        """Coefficients spread over the degrees, (K, 3, t + 1, t + 1)."""
        return coefficient_grid(self.dictionary.degrees, self.support, self.coefficients, self.degree)

    def _combined(self, patch: int, u: Array, v: Array) -> Array:
        """A patch's functions without their origin, (3, N), from tables of the polynomials or of their derivatives."""
        return combine(self.grids[patch], u, v) / self.scales[patch][:, None]

    @property
    def at_patch_vertices(self) -> Array:
        """Each patch's own value at each of its vertices, before blending, (M, 3)."""
        values = np.empty((len(self.patch_vertices), 3))
        for first, end in runs_of_rows(self.vertex_offsets, POINTS_AT_ONCE):
            rows = slice(self.vertex_offsets[first], self.vertex_offsets[end])
            self._patchwise(first, self.vertex_offsets[first : end + 1], self.domains[:, rows], values[rows])
        return values

    def at_patch_samples(self, samples: Array) -> Iterator[tuple[slice, Array]]:
        """Evaluate each patch by itself at the same points of each of its triangles, some patches at a time.

        Parameters
        ----------
        samples
            Barycentric coordinates, (q, 3).

        Yields
        ------
        triangles, values
            A run of patch triangles, and the patches' own surfaces there, (n, q, 3), scene units.
        """
        count = len(samples)
        for first, end in runs_of_rows(self.triangle_offsets, POINTS_AT_ONCE // count):
            rows = slice(self.triangle_offsets[first], self.triangle_offsets[end])
            domains = np.einsum("qk,cskx->csqx", samples, self.domains[:, self.corners[rows]])
            values = np.empty((rows.stop - rows.start, count, 3))
            offsets = count * self.triangle_offsets[first : end + 1]
            self._patchwise(first, offsets, domains.reshape(len(domains), -1, 2), values.reshape(-1, 3))
            yield rows, values

    def _patchwise(self, first: int, offsets: Indices, domain: Array, values: Array) -> None:
        """Put values of patches from `first` on at parameters (C, N, 2), split at `offsets`, into `values` (N, 3)."""
        offsets = offsets - offsets[0]
        if self.native_functions is not None:
            values[:] = native.patch_values(self.native_functions, first, offsets, domain)
            return
        # tables for many patches at once, because single patches are expensive
        u, v = self.dictionary.tables(np.moveaxis(domain, -1, 0))
        for patch, (start, stop) in enumerate(pairwise(offsets), first):
            own = self._combined(patch, u[..., start:stop], v[..., start:stop])
            values[start:stop] = own.T + self.origins[patch]

    def at_vertices(self) -> Array:
        """The blended surface at the input vertices, (V, 3)."""
        points = self.blend_at_vertices(self.at_patch_vertices)
        if len(self.creases):
            points[self.closing.vertices] = self.closing.places
        return points

    def blend_at_vertices(self, values: Array) -> Array:
        """Blend the patches' values (M, 3) at the input vertices, (V, 3)."""
        nodes = self.fans.of_patches(self.patch_vertices, self.corners, self.mesh_triangles)
        return self.fans.blend(values, self.weights, nodes, self.vertices)

    def evaluate(self, face_index: ArrayLike, barycentric: ArrayLike) -> Array:
        """Evaluate the surface S(x) at points x of the mesh.

        Parameters
        ----------
        face_index
            Triangles, (N,); where all input faces are triangles these are its faces (see `triangles`, `polygon`).
        barycentric
            Barycentric coordinates in these triangles, (N, 3).

        Returns
        -------
        ndarray
            Points of the surface in scene units, (N, 3).

        Raises
        ------
        InputError
            When a triangle does not exist or the arrays do not fit.

        Examples
        --------
        >>> from sparse_surface.solver import approximate
        >>> surface = approximate(vertices, faces).representation
        >>> surface.evaluate([0, 5], [[1, 0, 0], [0.2, 0.3, 0.5]]).shape
        (2, 3)
        """
        return self._evaluate(face_index, barycentric, tangents=False)[:, 0]

    def evaluate_with_tangents(self, face_index: ArrayLike, barycentric: ArrayLike) -> tuple[Array, Array]:
        """Evaluate the surface and its first derivatives; parameters and errors as in `evaluate`.

        Returns
        -------
        points, tangents
            (N, 3), and the derivatives along the triangle's edges 0 -> 1 and 0 -> 2, (N, 2, 3), scene units.
        """
        result = self._evaluate(face_index, barycentric, tangents=True)
        return result[:, 0], result[:, 1:]

    def normals(self, face_index: ArrayLike, barycentric: ArrayLike) -> Array:
        """Unit normals of the surface, (N, 3); zero where the surface has no tangent plane."""
        tangents = self.evaluate_with_tangents(face_index, barycentric)[1]
        return unit(np.asarray(np.cross(tangents[:, 0], tangents[:, 1]), dtype=np.float64))

    def _evaluate(self, face_index: ArrayLike, barycentric: ArrayLike, tangents: bool, *, closed: bool = True) -> Array:
        """Points (N, 1, 3), or points and tangents (N, 3, 3): the sum over the patches.

        The points are sorted by triangle, so that each patch finds its own in runs.
        """
        face, inside = checked_places(face_index, barycentric, len(self.triangles))
        sorted_ = bool((face[1:] >= face[:-1]).all())
        order = np.zeros(0, dtype=np.int64) if sorted_ else stable_order(face)
        face, inside = (face, inside.T) if sorted_ else (face[order], rows_at(inside, order).T)
        sums = flat_part(self.vertices, self.triangles, self.input_weights, face, inside, tangents)
        if self.native_functions is not None:
            starts = np.flatnonzero(np.diff(face, prepend=-1))
            where = face[starts], np.append(starts, len(face))
            own = self.native_functions, self.native_blend, self.holders
            sums = native.with_patches(*own, where, inside, sums)
        else:
            inside, sums = np.ascontiguousarray(inside), np.ascontiguousarray(sums)  # a patch takes from few rows
            runs = np.concatenate([[0], np.cumsum(np.bincount(face, minlength=len(self.triangles)))])
            for patch, points, triangle in self._portions(runs):
                part = self._patch_part(patch, triangle, inside.take(points, axis=1), tangents)
                for total, own in zip(sums, part, strict=True):
                    total[points] += own
        if closed and len(self.creases):
            points, correction = self.closing.at(face, inside, tangents)
            sums[:, points] += correction
        ordered = np.ascontiguousarray(sums.T)
        result = ordered if sorted_ else np.empty_like(ordered)
        if not sorted_:
            result[order] = ordered
        return result.reshape(len(face), len(sums) // 3, 3)

    def _portions(self, runs: Indices) -> Iterator[tuple[int, Indices, Indices]]:
        """Yield (patch, points, patch triangles): which points a patch holds, in handy portions.

        Parameters
        ----------
        runs
            The points `runs[t]:runs[t + 1]` lie in the mesh triangle t, (T + 1,).
        """
        first, end = runs[self.mesh_triangles], runs[self.mesh_triangles + 1]
        count = np.where(self.weighty, end - first, 0)
        for patch in np.unique(self.patch_of_triangle[count > 0]):
            triangles = np.arange(self.triangle_offsets[patch], self.triangle_offsets[patch + 1])
            lengths = count[triangles]
            ends = np.cumsum(lengths)
            points = np.repeat(first[triangles] - (ends - lengths), lengths) + np.arange(ends[-1])
            triangle = np.repeat(triangles, lengths)
            for start in range(0, len(points), POINTS_AT_ONCE):
                part = slice(start, start + POINTS_AT_ONCE)
                yield int(patch), points[part], triangle[part]

    def _patch_part(self, patch: int, triangle: Indices, inside: Array, tangents: bool) -> Array:
        """A patch's part phi h of the surface at n points, (3, n), and with `tangents` of both tangents, (9, n).

        Parameters
        ----------
        triangle
            Patch triangle of each point, (n,).
        inside
            Barycentric coordinates, (3, n).
        """
        weights, ends = (table.take(triangle, axis=-1) for table in self._corner_table)
        phi = inside[0] * weights[0] + inside[1] * weights[1] + inside[2] * weights[2]
        u, v = self.dictionary.tables(inside[0] * ends[0] + inside[1] * ends[1] + inside[2] * ends[2])
        value = self._combined(patch, u, v) + self.origins[patch][:, None]
        parts = [phi * value]
        if tangents:
            along_u = self._combined(patch, self.dictionary.derivative_tables(u), v)
            along_v = self._combined(patch, u, self.dictionary.derivative_tables(v))
            for k in (1, 2):
                edge = ends[k] - ends[0]
                slope = along_u * edge[0] + along_v * edge[1]
                parts.append((weights[k] - weights[0]) * value + phi * slope)
        return np.concatenate(parts)


save, load = Representation.save, Representation.load

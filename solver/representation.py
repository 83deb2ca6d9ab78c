"""The representation: everything that is needed to evaluate the surface anywhere.

At a point x of a triangle the surface is the blend S(x) = sum_k phi_k(x) h_k(Phi_k(x)) of the patches that contain the triangle;
h_k is a sparse polynomial, Phi_k maps the triangle linearly into the patch's optimised domain, and phi_k interpolates the
blending weights linearly.  Where no patch has weight the input itself shows through.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .dictionary import Dictionary, coefficient_grid, combine
from .errors import InputError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

POINTS_AT_ONCE = 4096


@dataclass(frozen=True)
class Representation:
    """K patches over a mesh of V vertices, T triangles; M patch vertices and S patch triangles in ragged arrays.

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
        Optimised and initial domains in the patches' frames, (C, M, 2) with C = 1 (common) or 3 (one for each coordinate).
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

    @property
    def patches(self) -> int:
        """Number of patches, K."""
        return len(self.origins)

    @cached_property
    def dictionary(self) -> Dictionary:
        """The basis functions that `support` counts."""
        return Dictionary(self.degree, self.basis)

    @cached_property
    def corners(self) -> Indices:
        """Patch vertices, counted over all patches, at the corners of the patch triangles, (S, 3)."""
        counts = np.diff(self.triangle_offsets)
        return self.patch_triangles + np.repeat(self.vertex_offsets[:-1], counts)[:, None]

    @cached_property
    def _patch_of_triangle(self) -> Indices:
        """Patch of each patch triangle, (S,)."""
        return np.repeat(np.arange(self.patches), np.diff(self.triangle_offsets))

    @cached_property
    def _pieces(self) -> tuple[Indices, Indices]:
        """Patch triangles that have weight, sorted by mesh triangle, and where each mesh triangle's begin (T + 1,)."""
        with_weight = np.flatnonzero(self.weights[self.corners].max(axis=1, initial=0.0) > 0.0)
        order = with_weight[np.argsort(self.mesh_triangles[with_weight], kind="stable")]
        counts = np.bincount(self.mesh_triangles[order], minlength=len(self.triangles))
        return order, np.concatenate([[0], np.cumsum(counts)])

    @cached_property
    def _grids(self) -> Array:
        """Coefficients spread over the degrees, (K, 3, t + 1, t + 1)."""
        return coefficient_grid(self.dictionary.degrees, self.support, self.coefficients, self.degree)

    def patch_values(self, patch: int, domain: Array) -> Array:
        """Values of one patch's functions.

        Parameters
        ----------
        patch
            Number of the patch.
        domain
            Parameters in the patch's frame, (C, N, 2).

        Returns
        -------
        ndarray
            Points in scene units, (N, 3).
        """
        u, v = self._tables(domain)
        values = combine(self._grids[patch], u, v) / self._scale(patch)
        points: Array = values.T + self.origins[patch]
        return points

    def patch_gradients(self, patch: int, domain: Array) -> Array:
        """Derivatives of one patch's functions along u and v of its frame, (2, N, 3); parameters (C, N, 2)."""
        u, v = self._tables(domain)
        grid = self._grids[patch]
        slopes = combine(grid, self.dictionary.derivative_tables(u), v), combine(
            grid, u, self.dictionary.derivative_tables(v)
        )
        return np.stack([(slope / self._scale(patch)).T for slope in slopes])

    def _tables(self, domain: Array) -> tuple[Array, Array]:
        parameters = np.moveaxis(domain, -1, 0)
        return self.dictionary.tables(parameters[0]), self.dictionary.tables(parameters[1])

    def _scale(self, patch: int) -> Array:
        return self.scales[patch][:, None]

    def at_patch_vertices(self) -> Array:
        """Each patch's own value at each of its vertices, before blending, (M, 3)."""
        values = np.empty((len(self.patch_vertices), 3))
        for k in range(self.patches):
            part = slice(self.vertex_offsets[k], self.vertex_offsets[k + 1])
            values[part] = self.patch_values(k, self.domains[:, part])
        return values

    def at_vertices(self) -> Array:
        """The blended surface at the input vertices, (V, 3)."""
        return self.blend_at_vertices(self.at_patch_vertices())

    def blend_at_vertices(self, values: Array) -> Array:
        """Blend the patches' values (M, 3) at the input vertices, (V, 3)."""
        size = len(self.vertices)
        total = np.bincount(self.patch_vertices, weights=self.weights, minlength=size)
        rest = np.maximum(1.0 - total, 0.0)
        rest[rest < 1e-12] = 0.0
        weighted = values * self.weights[:, None]
        sums = [np.bincount(self.patch_vertices, weights=column, minlength=size) for column in weighted.T]
        points: Array = np.stack(sums, axis=1) + rest[:, None] * self.vertices
        # A vertex that no patch moves keeps its place to the last bit.
        points[total == 0.0] = self.vertices[total == 0.0]
        return points

    def evaluate(self, face_index: Indices, barycentric: Array) -> Array:
        """Evaluate the surface.

        Parameters
        ----------
        face_index
            Triangles, (N,); the input's own face numbers where all of its faces are triangles (see `triangles`, `polygon`).
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
        """
        return self._evaluate(face_index, barycentric, derivatives=False)[0]

    def evaluate_with_tangents(self, face_index: Indices, barycentric: Array) -> tuple[Array, Array]:
        """Evaluate the surface and its first derivatives.

        Returns
        -------
        points
            (N, 3).
        tangents
            Derivatives along the triangle's edges 0 -> 1 and 0 -> 2, (N, 2, 3), scene units.
        """
        return self._evaluate(face_index, barycentric, derivatives=True)

    def normals(self, face_index: Indices, barycentric: Array) -> Array:
        """Unit normals of the surface, (N, 3); zero where the surface has no tangent plane."""
        tangents = self.evaluate_with_tangents(face_index, barycentric)[1]
        normal = np.cross(tangents[:, 0], tangents[:, 1])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        return np.divide(normal, length, out=np.zeros_like(normal), where=length > 0.0)

    def _evaluate(self, face_index: Indices, barycentric: Array, derivatives: bool) -> tuple[Array, Array]:
        face, corners = _checked_queries(face_index, barycentric, len(self.triangles))
        total = np.zeros(len(face))
        points = np.zeros((len(face), 3))
        # derivatives along the three barycentric coordinates, and those of the weights' sum
        slopes = np.zeros((len(face), 3, 3)) if derivatives else np.zeros((0, 3, 3))
        total_slope = np.zeros((len(face), 3))
        for patch, query, triangle in self._pairs(face):
            at = self.corners[triangle]
            weight = self.weights[at] if self.blending == "partition" else np.ones((len(at), 3))
            blend = (weight * corners[query]).sum(axis=1)
            corner_domain = self.domains[:, at]
            domain = np.einsum("cnkx,nk->cnx", corner_domain, corners[query])
            value = self.patch_values(patch, domain)
            points[query] += blend[:, None] * value
            total[query] += blend
            if derivatives:
                gradient = self.patch_gradients(patch, domain)
                corner_domain = np.broadcast_to(corner_domain, (3, *corner_domain.shape[1:]))
                along = np.einsum("xnd,dnkx->nkd", gradient, corner_domain)
                slopes[query] += weight[:, :, None] * value[:, None] + blend[:, None, None] * along
                total_slope[query] += weight
        return self._blended(face, corners, points, total, slopes, total_slope)

    def _blended(
        self, face: Indices, corners: Array, points: Array, total: Array, slopes: Array, total_slope: Array
    ) -> tuple[Array, Array]:
        """Divide by the weights' sum (uniform), or fill it up with the input itself (partition)."""
        ends = self.vertices[self.triangles[face]]
        flat = np.einsum("nk,nkd->nd", corners, ends)
        if self.blending == "uniform":
            covered = total > 0.0
            scale = np.where(covered, total, 1.0)
            points = np.where(covered[:, None], points / scale[:, None], flat)
            if len(slopes):
                quotient = (slopes - total_slope[:, :, None] * points[:, None]) / scale[:, None, None]
                slopes = np.where(covered[:, None, None], quotient, ends)
        else:
            rest = 1.0 - total
            rest[np.abs(rest) < 1e-12] = 0.0
            points = points + rest[:, None] * flat
            if len(slopes):
                fading = np.where(rest[:, None] == 0.0, 0.0, 1.0 - total_slope)
                slopes = slopes + rest[:, None, None] * ends + fading[:, :, None] * flat[:, None]
        return points, slopes[:, 1:] - slopes[:, :1]

    def _pairs(self, face: Indices):  # type: ignore[no-untyped-def]
        """Yield (patch, queries, patch triangles): which queries a patch answers, in handy portions."""
        pieces, offsets = self._pieces
        counts = offsets[face + 1] - offsets[face]
        query = np.repeat(np.arange(len(face)), counts)
        first = np.repeat(offsets[face] - np.concatenate([[0], np.cumsum(counts)[:-1]]), counts)
        triangle = pieces[first + np.arange(len(query))]
        patch = self._patch_of_triangle[triangle]
        order = np.argsort(patch, kind="stable")
        query, triangle = query[order], triangle[order]
        bounds = np.searchsorted(patch[order], np.arange(self.patches + 1))
        for k in range(self.patches):
            for start in range(bounds[k], bounds[k + 1], POINTS_AT_ONCE):
                part = slice(start, min(start + POINTS_AT_ONCE, bounds[k + 1]))
                yield k, query[part], triangle[part]


def _checked_queries(face_index: Indices, barycentric: Array, triangles: int) -> tuple[Indices, Array]:
    face, corners = np.asarray(face_index), np.asarray(barycentric, dtype=np.float64)
    if face.ndim != 1 or corners.shape != (len(face), 3):
        raise InputError("Evaluating needs N face numbers and an array of N x 3 barycentric coordinates.")
    if len(face) and (face.dtype.kind not in "iu" or face.min() < 0 or face.max() >= triangles):
        raise InputError(f"Face numbers must be whole numbers from 0 to {triangles - 1}.")
    return face.astype(np.int64), corners

"""Closing the surface along its creases.

The patches of a crease's two sides know nothing of each other, so their surfaces do not quite meet there.  On each
triangle a correction is added that is largest at the crease and fades out over this one row of triangles,

    sum_v lambda_v d_v + sum_e (lambda_v + lambda_w) B_e(lambda_w / (lambda_v + lambda_w)),

the first sum over the triangle's corners v, the second over its crease edges e = (v, w); lambda are the barycentric
coordinates.  d_v leads from the surface of the triangle's own side to the place where all sides meet at v.  B_e leads
to where both sides meet along the edge, less the linear part that the d_v have made up for.

Sides meet where their tangent planes do: at the c that minimises, with p_i and n_i each side's point and unit normal,

    sum_i (n_i . (c - p_i))^2 + SLIDE |c - p_i|^2.

So each side mostly slides within itself and keeps its normals; the mean of the p_i would tilt both.  Where the planes
are nearly parallel, as at the end of a crease, the second term decides, and c is close to that mean.

Both sides are polynomials of degree t + 1 along the edge: t of the patches' functions, and 1 of the weights that blend
them.  B_e leads to the polynomial of that degree through the c at t + 2 Chebyshev points, the same for both sides, so
the surface has no gap beyond rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from ..arrays import Array, Indices, any_of, slices_of
from ..mesh.edges import edge_keys
from ..mesh.topology import fans_between_creases, mean_over_nodes
from ..mesh.triangle_mesh import TriangleMesh
from ..native.bounds import Correction
from ..processes.each import Each

ROUNDING = 1e-12
"""By how much a sum of weights may miss one."""

SLIDE = 0.1
"""Weight of distances within a side's tangent plane, relative to those from it."""

CREASES_AT_ONCE = 2000
"""Edges of creases that are closed together: more would only take memory."""

Evaluated = Callable[[Indices, Array], tuple[Array, Array]]
"""Evaluates what is to be closed: triangles (N,) and barycentric coordinates (N, 3) to points and normals, (N, 3)."""


@dataclass(frozen=True)
class Fans:
    """The fans of triangles around the vertices between creases; each is a node.

    Attributes
    ----------
    corners
        Node of each triangle corner, (T, 3).  Node `v` < V belongs to vertex `v`.
    vertex
        Vertex of each node, (N,).
    sides
        The two sides of each crease, (C, 2); side `3 t + i` of triangle t runs from its corner i to corner i + 1.
    """

    corners: Indices
    vertex: Indices
    sides: Indices

    @classmethod
    def of(cls, triangles: Indices, creases: Indices, vertices: int) -> Fans:
        """Find the fans between creases, (C, 2); without any, nodes are vertices."""
        if not len(creases):
            return cls(triangles, np.arange(vertices), np.zeros((0, 2), dtype=np.int64))
        return cls(*fans_between_creases(triangles, creases, vertices))

    @classmethod
    def of_mesh(cls, mesh: TriangleMesh) -> Fans | None:
        """The same of a mesh that is cut along its creases; None where its nodes are others, or it has no creases."""
        if mesh.crowded or not len(mesh.creases):
            return None
        edge = np.flatnonzero(mesh.edge_triangles[:, 1] < 0)
        triangle = mesh.edge_triangles[edge, 0]
        corner = (mesh.triangle_edges[triangle] == edge[:, None]).argmax(axis=1)
        vertices, (low, high) = len(mesh.vertices), mesh.creases.T
        key = edge_keys(mesh.triangles[triangle, corner], mesh.triangles[triangle, (corner + 1) % 3], vertices)
        own = np.flatnonzero(np.isin(key, edge_keys(low, high, vertices)))
        sides = 3 * triangle[own] + corner[own]
        sides = sides[np.lexsort((sides, key[own]))]
        return cls(mesh.nodes, mesh.node_vertex, sides.reshape(-1, 2)) if len(own) == 2 * len(mesh.creases) else None

    def of_patches(self, vertices: Indices, corners: NDArray[np.integer[Any]], triangles: Indices) -> Indices:
        """Node of each patch vertex, (M,), from its vertex and the patch triangles' corners and mesh triangles."""
        nodes = vertices.copy()
        if len(self.sides):
            nodes[corners] = self.corners[triangles]
        return nodes

    def blend(self, values: Array, weights: Array, nodes: Indices, vertices: Array) -> Array:
        """Blend values of patches (M, 3) with weights (M,) at nodes (M,), and the vertices (V, 3) themselves with what
        the weights leave; the mean over each vertex's nodes.
        """
        own, size = vertices[self.vertex], len(self.vertex)
        total = np.bincount(nodes, weights=weights, minlength=size)
        rest = np.maximum(1.0 - total, 0.0)
        rest[rest < ROUNDING] = 0.0
        weighted = values * weights[:, None]
        sums = [np.bincount(nodes, weights=column, minlength=size) for column in weighted.T]
        points: Array = np.stack(sums, axis=1) + rest[:, None] * own
        # A vertex that no patch moves keeps its place to the last bit.
        points[total == 0.0] = own[total == 0.0]
        return self.mean(points, len(vertices))

    def mean(self, values: Array, vertices: int) -> Array:
        """Mean over the nodes of each vertex, (V, 3), of values at the nodes, (N, 3)."""
        return mean_over_nodes(values, self.vertex, vertices)


@dataclass(frozen=True)
class Closing:
    """The correction that closes a surface, on the R triangles that have any.

    Attributes
    ----------
    row
        Which of them each triangle is, (T,); -1 elsewhere.
    corners
        d_v at their corners, (R, 3, 3), scene units.
    edge
        Polynomial of each of their sides, (R, 3); -1 where it is not a crease.
    polynomials
        Chebyshev coefficients of B_e along the sides on [-1, 1], (P, n, 3), scene units.
    vertices, places
        Where the sides meet at vertices, (n,) and (n, 3), scene units.
    """

    row: Indices
    corners: Array
    edge: Indices
    polynomials: Array
    vertices: Indices
    places: Array

    @classmethod
    def of(cls, fans: Fans, triangles: Indices, degree: int, surface: Evaluated, each: Each = map) -> Closing:
        """Compute the correction.

        Parameters
        ----------
        triangles
            Vertices of the triangles' corners, (T, 3).
        degree
            Highest degree of the patches' functions.
        surface
            What is to be closed.
        each
            Closes parts of the creases, perhaps several at once.
        """
        away, vertices, places = _from_own_side(fans, triangles, surface)
        sides = fans.sides.ravel()
        moved = any_of(away != 0.0)
        concerned = any_of(moved[fans.corners])
        concerned[sides // 3] = True
        rows = np.flatnonzero(concerned)
        row = np.full(len(triangles), -1)
        row[rows] = np.arange(len(rows))
        edge = np.full((len(rows), 3), -1)
        edge[row[sides // 3], sides % 3] = np.arange(len(sides))
        pieces = [fans.sides[own] for own in slices_of(len(fans.sides), CREASES_AT_ONCE)]
        along = np.concatenate(list(each(lambda own: _along_sides(own, triangles, degree, surface), pieces)))
        return cls(row, away[fans.corners[rows]], edge, along, vertices, places)

    def at(self, face: Indices, inside: Array, tangents: bool) -> tuple[Indices, Array]:
        """Which of N points have a correction, (n,), and what it is, (3, n), with `tangents` of both tangents, (9, n).

        Parameters
        ----------
        face, inside
            Triangles (N,) and barycentric coordinates (3, N).
        """
        which = np.flatnonzero(self.row[face] >= 0)
        row, inside = self.row[face[which]], inside[:, which]
        corners = self.corners[row].transpose(1, 2, 0)
        parts = [(inside[:, None] * corners).sum(axis=0)]
        if tangents:
            parts += [corners[1] - corners[0], corners[2] - corners[0]]
        for side in range(3):
            there = np.flatnonzero(self.edge[row, side] >= 0)
            ends = inside[side, there], inside[(side + 1) % 3, there]
            value, slope = self._along(self.edge[row[there], side], *ends, tangents)
            parts[0][:, there] += (ends[0] + ends[1]) * value
            for k in range(1, len(parts)):
                # along the triangle's edge 0 -> k
                step = np.array([-1.0, *(float(c == k) for c in (1, 2))])
                start, end = step[side], step[(side + 1) % 3]
                parts[k][:, there] += (start + end) * value + slope * (end * ends[0] - start * ends[1])
        return which, np.concatenate(parts)

    def _along(self, polynomial: Indices, start: Array, end: Array, slopes: bool) -> tuple[Array, Array]:
        """B and (lambda_v + lambda_w) B' for lambda_v = start, lambda_w = end; both (3, n).

        With m = lambda_v + lambda_w and t = lambda_w / m, m B(t) changes by m' B + B' (lambda_w' lambda_v - lambda_v'
        lambda_w) / m, so the second is left divided by m.
        """
        total = start + end
        known = total > 0.0
        place = np.divide(end - start, total, out=np.zeros_like(total), where=known)
        table = chebyshev.chebvander(place, self.polynomials.shape[1] - 1)
        value = np.einsum("nj,njd->dn", table, self.polynomials[polynomial])
        if not slopes:
            return value, value
        slope = np.einsum("nj,njd->dn", table[:, :-1], self._slopes[polynomial])
        # the parameter of the polynomials runs from -1 to 1
        return value, np.divide(2.0 * slope, total, out=np.zeros_like(slope), where=known)

    def natively(self) -> Correction:
        """The same as the compiled kernel takes it."""
        return Correction(self.row, self.corners, self.edge, self.polynomials, *self._limits)

    def prepare(self) -> None:
        """Compute what is kept, before several threads ask for it."""
        _ = self._slopes, self._limits

    @cached_property
    def _slopes(self) -> Array:
        return _derivatives(self.polynomials, 1)

    def between_corners(self, triangle: Indices, corners: Array) -> tuple[Array, Array]:
        """Correction at the corners of parts of triangles, (n, 3, 3), and how far it is from linear in between, (n,).

        m B(lambda_w / m) with m = lambda_v + lambda_w has the second derivative B'' (b - t (a + b))^2 / m along a step
        (a, b) of lambda_v and lambda_w, which is at most B'' max(a^2, b^2) / m.

        Parameters
        ----------
        triangle, corners
            Triangles (n,) and the parts' corners in their barycentric coordinates, (n, 3, 3).
        """
        values, rest = np.zeros(corners.shape), np.zeros(len(triangle))
        which, at = self.at(np.repeat(triangle, 3), corners.reshape(-1, 3).T, False)
        values.reshape(-1, 3)[which] = at.T
        row = self.row[triangle]
        for side in range(3):
            there = np.flatnonzero((row >= 0) & (self.edge[row, side] >= 0))
            ends = corners[there][:, :, [side, (side + 1) % 3]]
            total, step = ends.sum(axis=2), np.abs(ends - np.roll(ends, 1, axis=1)).max(axis=(1, 2))
            largest, bend = (limit[self.edge[row[there], side]] for limit in self._limits)
            least, most = total.min(axis=1), total.max(axis=1)
            curved = np.divide(0.5 * bend * step**2, least, out=np.full(len(there), np.inf), where=least > 0.0)
            rest[there] += np.minimum(curved, 2.0 * most * largest)
        return values, rest

    @cached_property
    def _limits(self) -> tuple[Array, Array]:
        """Bounds of |B_e| and |B_e''| on [0, 1], (P,) each: Chebyshev polynomials are at most one."""
        bends = 4.0 * _derivatives(self.polynomials, 2)
        largest, bend = (np.abs(own).sum(axis=1) for own in (self.polynomials, bends))
        return np.sqrt((largest**2).sum(axis=1)), np.sqrt((bend**2).sum(axis=1))


def _derivatives(polynomials: Array, times: int) -> Array:
    """Chebyshev coefficients, (P, n - times, 3), of derivatives of polynomials, (P, n, 3), on [-1, 1]."""
    to_slopes = chebyshev.chebder(np.eye(polynomials.shape[1]), times)
    return np.matmul(to_slopes, polynomials)


def _from_own_side(fans: Fans, triangles: Indices, surface: Evaluated) -> tuple[Array, Indices, Array]:
    """d_v of each node, (N, 3), zero at vertices with one node only; the n other vertices, and c there, (n, 3)."""
    nodes, vertices = len(fans.vertex), int(fans.vertex.max()) + 1
    shared = np.bincount(fans.vertex, minlength=vertices)[fans.vertex] > 1
    asked = np.flatnonzero(shared[fans.corners.ravel()])
    points, normals = surface(asked // 3, np.eye(3)[asked % 3])
    node = fans.corners.ravel()[asked]
    own = np.zeros((nodes, 3))
    own[node[::-1]] = points[::-1]
    mean = fans.mean(own, vertices)
    away = own - mean[fans.vertex]
    # all corners of a fan speak for its node, whatever their order
    share = 1.0 / np.bincount(node, minlength=nodes)[node]
    planes = normals[:, :, None] * normals[:, None] * share[:, None, None]
    pulls = np.einsum("nij,nj->ni", planes, away[node])
    split, number = np.unique(fans.vertex[node], return_inverse=True)
    columns = np.concatenate([planes.reshape(-1, 9), pulls], axis=1).T
    sums: Array = np.stack([np.bincount(number, weights=column, minlength=len(split)) for column in columns], axis=1)
    places: Array = mean[split] + _slid(sums[:, :9].reshape(-1, 3, 3), sums[:, 9:], np.bincount(fans.vertex)[split])
    meeting = mean.copy()
    meeting[split] = places
    return np.where(shared[:, None], meeting[fans.vertex] - own, 0.0), split, places


def _slid(planes: Array, pulls: Array, sides: Indices | int) -> Array:
    """From the mean of the points to c, (..., 3), from the sums of n n^T and n n^T (p - mean) over the sides."""
    matrix = planes + SLIDE * np.asarray(sides)[..., None, None] * np.eye(3)
    return np.asarray(np.linalg.solve(matrix, pulls[..., None])[..., 0], dtype=np.float64)


def _along_sides(sides: Indices, triangles: Indices, degree: int, surface: Evaluated) -> Array:
    """Chebyshev coefficients of B_e for both sides of each crease, (2 C, n, 3)."""
    count = max(degree + 1, 2) + 1  # weights are linear; the input itself has weights, too
    places = chebyshev.chebpts1(count)
    shares = (places + 1.0) / 2.0
    flat = sides.ravel()
    inside = np.zeros((len(flat), count, 3))
    each = np.arange(len(flat))
    inside[each, :, flat % 3] = 1.0 - shares
    inside[each, :, (flat + 1) % 3] = shares
    # side numbers are 3 t + i, and the side ends at corner i + 1 of the same triangle
    points, normals = surface(np.repeat(flat // 3, count), inside.reshape(-1, 3))
    starts = triangles.ravel()[sides]
    opposed = starts[:, 0] != starts[:, 1]

    def turned(values: Array) -> Array:
        """The second side's from the first side's start on: the places are symmetric."""
        values = values.reshape(-1, 2, count, 3).copy()
        values[opposed, 1] = values[opposed, 1, ::-1]
        return values

    points, normals = turned(points), turned(normals)
    away = points - points.mean(axis=1, keepdims=True)
    pulls = (normals * (normals * away).sum(axis=-1, keepdims=True)).sum(axis=1)
    slid = _slid(np.einsum("cski,cskj->ckij", normals, normals), pulls, 2)
    to_meeting = slid[:, None] - away
    to_meeting[opposed, 1] = to_meeting[opposed, 1, ::-1]
    to_coefficients = np.linalg.inv(chebyshev.chebvander(places, count - 1))
    coefficients: Array = np.einsum("jk,pkd->pjd", to_coefficients, to_meeting.reshape(-1, count, 3))
    # without the line through its ends, at which the T_k are (-1)^k and 1
    start, end = coefficients[:, ::2].sum(axis=1), coefficients[:, 1::2].sum(axis=1)
    coefficients[:, 0] -= start
    coefficients[:, 1] -= end
    return coefficients

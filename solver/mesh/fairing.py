"""A fair surface beside a mesh: what patches with a domain for each coordinate are fitted to.

`curved` says what the triangles of a smooth shape stand for.  It lies a little off flat triangles, and where a mesh is
rough it ripples however smooth it is inside triangles: its normals swing about those interpolated between the corners,
n.  So the surface is off the triangles by s = sum_i b_i w_i + sum_(i < j) b_i b_j c_ij along the normals, where

    sum_t  mean_t |s|^2 + A_t rho_t mean_t |normal - n|^2

is least, the normal linear in s to first order and A_t the triangle's area: the balance does not depend on how fine the
mesh is.  rho_t follows from how well the mesh resolves a smooth shape around the triangle,

    r^2 = sum |normal of the curved surface - n|^2 / sum |normal of the triangle - n|^2,

over a few rings.  Over a smooth shape r falls with the length of edges; there nearly the curved surface is fair.  Where
curvature begins abruptly or edges are long beside it, r is a quarter, and n says no more than the triangles do, which
count.  In noise r comes near to one, and the surface ripples the more, the closer it is to the triangles:

    rho_t = RESOLVED a + NOISY r,   a = 1 / (1 + (r / COARSE)^POWER).

r is that of the normals that triangles weighted as in a sphere give.  For n they are then corrected in the share a
(`curved.corrected_normals`), which halves what they are off over a smooth shape.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array, Booleans, Indices
from .curved import STEEPEST, corrected_normals, curved_offsets, node_normals
from .normals import normals_and_areas, unit
from .sampling import SURFACE_SAMPLES
from .triangle_mesh import TriangleMesh

RESOLVED = 0.575
"""Weight of a squared angle, in radians, against squared distances in shares of the triangle's area, where a mesh
resolves a smooth shape."""
NOISY = 0.21
"""The same in noise."""
COARSE, POWER = 0.14, 4.4
"""Share r of the normals' differences that the curved surface leaves, from which on a mesh is coarse for its shape, and
how abruptly."""
RINGS = 3
"""How often both are averaged between triangles that share a corner before they are compared."""
STRAIGHT = 1e-6
"""Angles, in radians, that do not count."""
ENOUGH, MOST_STEPS = 1e-3, 100
"""Conjugate gradients end at this share of the first residual, or after so many steps."""

_QUADRATURE = np.repeat([0.109951743655322, 0.223381589678011], 3)
"""Weights of `SURFACE_SAMPLES`, exact up to degree 4."""
_SHAPES = np.concatenate([SURFACE_SAMPLES, SURFACE_SAMPLES * np.roll(SURFACE_SAMPLES, -1, axis=1)], axis=1)
_DISTANCE: Array = np.einsum("qa,q,qb->ab", _SHAPES, _QUADRATURE, _SHAPES)
"""mean_t |s|^2 as a form of w_0, w_1, w_2, c_01, c_12, c_20, (6, 6)."""


@dataclass(frozen=True)
class _Triangles:
    """What the energy takes from each triangle.

    Attributes
    ----------
    unknowns
        Numbers of w_0, w_1, w_2, c_01, c_12, c_20, (6, T): nodes, then edges.
    kept
        Which of them are free, (6, T).
    slopes
        Gradients of the barycentric coordinates in the triangle's plane, (3, 2, T).
    weight
        A_t rho_t, (T,).
    count
        Number of all unknowns.
    """

    unknowns: Indices
    kept: Booleans
    slopes: Array
    weight: Array
    count: int

    def collected(self, parts: Array) -> Array:
        """Sum what triangles say of their unknowns, (6, T), to all unknowns, (n,)."""
        total = np.bincount(self.unknowns.ravel(), (parts * self.kept).ravel(), self.count)
        return np.asarray(total, dtype=np.float64)

    def gradients(self, own: Array) -> Array:
        """Gradients of s at the corners, (3, 2, T), from the triangles' unknowns, (6, T)."""
        flat, bulges = sum(self.slopes[k] * own[k] for k in range(3)), own[3:]
        at = [flat + self.slopes[k - 2] * bulges[k] + self.slopes[k - 1] * bulges[k - 1] for k in range(3)]
        return np.stack(at)

    def turned(self, gradients: Array) -> Array:
        """The transpose of `gradients` times the second term's form, (6, T).

        The mean of a product of linear functions is (1 + delta_ij) / 12 as a form of their values at the corners.
        """
        total = gradients.sum(axis=0)
        weighted = (gradients + total) * (self.weight / 12.0)
        total = total * (self.weight / 3.0)
        nodes = [_dot(self.slopes[k], total) for k in range(3)]
        edges = [_dot(self.slopes[k - 2], weighted[k]) + _dot(self.slopes[k], weighted[k - 2]) for k in range(3)]
        return np.stack(nodes + edges)

    @staticmethod
    def squares(gradients: Array) -> Array:
        """Mean squares, (T,), of gradients that are given at the corners."""
        return ((gradients**2).sum(axis=(0, 1)) + (gradients.sum(axis=0) ** 2).sum(axis=0)) / 12.0

    def weighted(self, share: Array) -> _Triangles:
        """The same with a share, (T,), of the second term's weight."""
        return replace(self, weight=share * self.weight)

    def product(self, values: Array) -> Array:
        """The matrix of the energy times all unknowns, (n,)."""
        own = values[self.unknowns] * self.kept
        return self.collected(_DISTANCE @ own + self.turned(self.gradients(own)))

    def diagonal(self) -> Array:
        """Of that matrix, (n,); ones where an unknown is in no triangle or not free."""
        square = (self.slopes**2).sum(axis=1)
        following = np.roll(square, -1, axis=0)
        across = (self.slopes * np.roll(self.slopes, -1, axis=0)).sum(axis=1)
        turning = np.concatenate([square, (square + following + across) / 6.0]) * self.weight
        found = self.collected(np.diag(_DISTANCE)[:, None] + turning)
        return np.where(found > 0.0, found, 1.0)


def fair_offsets(mesh: TriangleMesh) -> tuple[Array, Array]:
    """Compute what leads from a mesh to the fair surface beside it.

    Returns
    -------
    tuple
        Moves of the nodes, (N, 3), and c of each triangle's sides, (T, 3, 3), as `curved.curved_offsets` returns them.
    """
    around, nodes = node_normals(mesh), mesh.nodes
    ends = np.stack([nodes, np.roll(nodes, -1, axis=1)])
    low, high = ends.min(axis=0).ravel(), ends.max(axis=0).ravel()
    keys, edges = np.unique(low * mesh.node_count + high, return_inverse=True)
    edges = edges.reshape(-1, 3)
    triangles, wanted = _triangles(mesh, around, edges, len(keys))
    share = _share(mesh, triangles, wanted, around)
    resolved = 1.0 / (1.0 + (share / COARSE) ** POWER)
    around = corrected_normals(mesh, around, _at_nodes(mesh, resolved))
    middles = unit(around[low] + around[high]).reshape(-1, 3, 3)
    triangles, wanted = _triangles(mesh, around, edges, len(keys))
    triangles = triangles.weighted(RESOLVED * resolved + NOISY * share)
    right, inverse = triangles.collected(triangles.turned(wanted)), 1.0 / triangles.diagonal()
    piece = mesh.pieces.piece[mesh.node_vertex]
    found = _solved(triangles.product, right, inverse, np.concatenate([piece, piece[keys // mesh.node_count]]))
    more = (found[triangles.unknowns[3:]] * triangles.kept[3:]).T
    return found[: mesh.node_count, None] * around, more[:, :, None] * middles


def _share(mesh: TriangleMesh, triangles: _Triangles, wanted: Array, around: Array) -> Array:
    """R of each triangle, (T,): which share of the differences between normals the curved surface leaves."""
    moves, bulges = curved_offsets(mesh)
    middles = unit(around[mesh.nodes] + np.roll(around[mesh.nodes], -1, axis=1))
    own = np.concatenate([(moves * around).sum(axis=1)[mesh.nodes.T], (bulges * middles).sum(axis=2).T])
    left, flat = triangles.squares(wanted - triangles.gradients(own)), triangles.squares(wanted)
    for _ in range(RINGS):
        left, flat = (_at_nodes(mesh, values)[mesh.nodes].mean(axis=1) for values in (left, flat))
    return np.asarray(np.sqrt(left / np.maximum(flat, STRAIGHT**2)))


def _at_nodes(mesh: TriangleMesh, values: Array) -> Array:
    """Means at the nodes, (N,), of what the triangles around them have, (T,)."""
    around = np.bincount(mesh.nodes.ravel(), minlength=mesh.node_count)
    total = np.bincount(mesh.nodes.ravel(), values.repeat(3), mesh.node_count)
    means: Array = total / np.maximum(around, 1)
    return means


def _triangles(mesh: TriangleMesh, around: Array, edges: Indices, edge_count: int) -> tuple[_Triangles, Array]:
    """What the energy takes from the triangles, and which gradients they want at their corners, (3, 2, T)."""
    corners = mesh.vertices[mesh.triangles]
    normals, areas = normals_and_areas(mesh.vertices, mesh.triangles)
    normals *= np.where(mesh.winding < 0, -1.0, 1.0)[:, None]
    sides = corners - corners[:, :1]
    first = unit(sides[:, 1])
    axes = np.stack([first, np.cross(normals, first)])
    x, y = np.einsum("atd,tkd->akt", axes, sides)
    double = x[1] * y[2] - x[2] * y[1]
    double[double == 0.0] = np.inf
    slopes = np.stack([np.roll(y, -1, axis=0) - np.roll(y, 1, axis=0), np.roll(x, 1, axis=0) - np.roll(x, -1, axis=0)])
    own = around[mesh.nodes]
    along = np.einsum("tkd,td->kt", own, normals)
    steep = np.zeros(mesh.node_count, dtype=bool)
    steep[mesh.nodes.T[along < np.cos(np.radians(STEEPEST))]] = True
    sure = ~steep[mesh.nodes].any(axis=1) & np.isfinite(double)
    weight = np.where(sure, areas, 0.0)
    unsure = np.zeros(edge_count, dtype=bool)
    unsure[edges[~sure]] = True
    unknowns = np.concatenate([mesh.nodes.T, mesh.node_count + edges.T])
    kept = np.concatenate([np.ones((3, len(edges)), dtype=bool), ~unsure[edges.T]])
    wanted = -np.einsum("tkd,atd->kat", own, axes) / np.where(sure, along, 1.0)[:, None]
    count = mesh.node_count + edge_count
    return _Triangles(unknowns, kept, slopes.transpose(1, 0, 2) / double, weight, count), wanted


def _dot(one: Array, other: Array) -> Array:
    return one[0] * other[0] + one[1] * other[1]


def _solved(apply: Callable[[Array], Array], right: Array, inverse: Array, piece: Indices) -> Array:
    """Conjugate gradients from zero, preconditioned by the diagonal; each piece of unknowns (n,) for itself.

    No piece ends sooner because another is larger.  Sums are NumPy's own, which do not depend on how many threads BLAS
    has.
    """

    def summed(one: Array, other: Array) -> Array:
        product = one * other
        return np.asarray(np.bincount(piece, product) if several else [product.sum()], dtype=np.float64)

    several = bool(piece.any())
    found, left, moved = np.zeros_like(right), right.copy(), inverse * right
    way, size = moved, summed(left, moved)
    enough = ENOUGH**2 * size
    for _ in range(MOST_STEPS):
        active = size > enough
        if not active.any():
            break
        turned = apply(way)
        step = np.divide(size, summed(way, turned), out=np.zeros_like(size), where=active)[piece]
        found += step * way
        left -= step * turned
        moved = inverse * left
        before, size = size, np.where(active, summed(left, moved), 0.0)
        way = moved + np.divide(size, before, out=np.zeros_like(size), where=active)[piece] * way
    return found

"""A fair surface beside a mesh: what patches with a domain for each coordinate are fitted to.

`curved` says what the triangles of a smooth shape stand for.  Where a mesh is rough, the surface through its vertices
ripples however smooth it is inside triangles: its normals swing about those interpolated between the corners, n.  So it
is moved along its normals, by s = sum_i b_i w_i + sum_(i < j) b_i b_j c_ij over each triangle, where

    sum_t  mean_t |s|^2 + SMOOTHNESS A_t rho_t mean_t |normal - n|^2

is least, the normal linear in s to first order and A_t the triangle's area: the balance does not depend on how fine the
mesh is.  Two things decide on rho_t.  Where the surface is within a few degrees of n, nothing ripples, and it stays;
where corner normals are far from the triangle's own they say less:

    rho_t = r^2 / (r^2 + ROUGH^2) (1 - (angle / UNSURE)^2)^2,   r^2 = mean_t |normal - n|^2 before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array, Booleans, Indices
from .curved import STEEPEST, curved_offsets, node_normals
from .normals import normals_and_areas, unit
from .sampling import SURFACE_SAMPLES
from .triangle_mesh import TriangleMesh

SMOOTHNESS = 0.38
"""Weight of a squared angle, in radians, against squared distances in shares of the triangle's area."""
CURVED_SHARE = 0.75
"""How far from the flat triangles towards the curved surface beside them the surface lies before it is moved."""
ROUGH = 2.0
"""Degrees, root mean square, between the surface's normals and those between the corners at which these count half."""
UNSURE = 18.0
"""Degrees between the normals of a triangle and of its corners from which on the latter say nothing."""
ENOUGH, MOST_STEPS = 1e-3, 60
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
        SMOOTHNESS A_t rho_t, (T,).
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
    triangles, wanted = _triangles(mesh, around, edges.reshape(-1, 3), len(keys))
    middles = unit(around[low] + around[high]).reshape(-1, 3, 3)
    moves, bulges = (CURVED_SHARE * own for own in curved_offsets(mesh))
    before = np.concatenate([(moves * around).sum(axis=1)[nodes.T], (bulges * middles).sum(axis=2).T])
    missing = wanted - triangles.gradients(before)
    rough = triangles.squares(missing)
    triangles = triangles.weighted(rough / (rough + np.radians(ROUGH) ** 2))
    right, inverse = triangles.collected(triangles.turned(missing)), 1.0 / triangles.diagonal()
    piece = mesh.pieces.piece[mesh.node_vertex]
    found = _solved(triangles.product, right, inverse, np.concatenate([piece, piece[keys // mesh.node_count]]))
    more = (found[triangles.unknowns[3:]] * triangles.kept[3:]).T
    return moves + found[: mesh.node_count, None] * around, bulges + more[:, :, None] * middles


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
    least = along.min(axis=0)
    sure = (least >= np.cos(np.radians(STEEPEST))) & np.isfinite(double)
    angle = np.degrees(np.arccos(np.clip(least, -1.0, 1.0)))
    weight = np.where(sure, SMOOTHNESS * areas * np.maximum(1.0 - (angle / UNSURE) ** 2, 0.0) ** 2, 0.0)
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

"""Regularisation of the domain: Q(U) = beta1 Q1(U) + beta2 Q2(U) (eq. 4).

Q1 holds every parameter near its start; Q2 sums (s1 - 1)^2 + (s2 - 1)^2 over the triangles, with s1, s2 the *signed*
singular values of the Jacobian J of the domain transformation U0 -> U, weighted with the triangle's area.  In closed
form

    (s1 - 1)^2 + (s2 - 1)^2 = |J|^2 + 2 - 2 sqrt((J11 + J22)^2 + (J12 - J21)^2),

which is |J - R|^2 with R the rotation nearest to J (Liu et al. 2008, section 4.4).  As the values are signed, the term
also resists flips.  Domains are stored component first, (2, N): all u, then all v, of all patches of a batch in a row.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..arrays import Array, Indices
from .sparse_matrices import for_both, rows_of_three


@dataclass(frozen=True)
class DomainEnergy:
    """Q1, Q2 and their derivatives on given triangulations: N vertices and T triangles, of any number of patches.

    Attributes
    ----------
    start
        Initial domain U0, (2, N).
    area
        Areas of the initial domain's triangles, (T,).
    along_u, along_v
        Sparse (T, N): derivatives along u and v of a piecewise linear function on the initial domain.
    """

    start: Array
    area: Array
    along_u: sp.csr_matrix
    along_v: sp.csr_matrix

    @classmethod
    def of(cls, start: Array, triangles: Indices) -> DomainEnergy:
        """Energy of transformations of the domain `start` (2, N) with `triangles` (T, 3).

        Triangles without area (padding) have no weight and a zero Jacobian.
        """
        a, b, c = (start[:, triangles[:, k]] for k in range(3))
        doubled = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        inverse = np.divide(1.0, doubled, out=np.zeros_like(doubled), where=doubled != 0.0)
        # gradient of a vertex's hat function: the opposite edge, turned by a right angle, over the doubled area
        opposite = np.stack([c - b, a - c, b - a], axis=-1)
        along_u = rows_of_three(-opposite[1] * inverse[:, None], triangles, start.shape[1])
        along_v = rows_of_three(opposite[0] * inverse[:, None], triangles, start.shape[1])
        return cls(start, np.abs(doubled) / 2.0, along_u, along_v)

    def jacobian(self, domain: Array) -> Array:
        """Jacobian of the transformation U0 -> `domain` (2, N) on every triangle, (2, 2, T)."""
        rows: Array = self._gradient @ domain.ravel()
        return rows.reshape(2, 2, -1)

    def proximity(self, domain: Array) -> Array:
        """Q1 by vertex: squared distances from the initial domain, (N,)."""
        distance: Array = ((domain - self.start) ** 2).sum(axis=0)
        return distance

    def rigidity(self, jacobian: Array) -> Array:
        """Q2 by triangle: area times |J - R|^2, (T,)."""
        norm = (jacobian**2).sum(axis=(0, 1))
        length = np.hypot(jacobian[0, 0] + jacobian[1, 1], jacobian[0, 1] - jacobian[1, 0])
        return self.area * np.maximum(norm + 2.0 - 2.0 * length, 0.0)

    def rigidity_gradient(self, jacobian: Array) -> Array:
        """Gradient of the summed Q2 with respect to the domain, (2, N): 2 D^T A (J - R)."""
        force = 2.0 * self.area * (jacobian - nearest_rotation(jacobian))
        summed: Array = self._divergence @ force.ravel()
        return summed.reshape(2, -1)

    @cached_property
    def _gradient(self) -> sp.csr_matrix:
        """Derivatives along u and v of both coordinates, (4 T, 2 N)."""
        return for_both(sp.vstack([self.along_u, self.along_v], format="csr"))

    @cached_property
    def _divergence(self) -> sp.csr_matrix:
        return self._gradient.T.tocsr()

    def laplacian(self) -> sp.csr_matrix:
        """Half the Hessian of Q2 with the rotations held: the cotangent Laplacian of the initial domain, (N, N)."""
        triangles = self.along_u.indices.reshape(-1, 3)
        u, v = self.along_u.data.reshape(-1, 3), self.along_v.data.reshape(-1, 3)
        entries = self.area[:, None, None] * (u[:, :, None] * u[:, None, :] + v[:, :, None] * v[:, None, :])
        rows, columns = np.broadcast_arrays(triangles[:, :, None], triangles[:, None, :])
        size = self.along_u.shape[1]
        return sp.csr_matrix((entries.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size))


def nearest_rotation(jacobian: Array) -> Array:
    """Rotations nearest to the matrices `jacobian` (2, 2, T); the identity where all rotations are equally near."""
    cosine = jacobian[0, 0] + jacobian[1, 1]
    sine = jacobian[1, 0] - jacobian[0, 1]
    length = np.hypot(cosine, sine)
    flat = length == 0.0
    safe = np.where(flat, 1.0, length)
    cosine, sine = np.where(flat, 1.0, cosine / safe), sine / safe
    return np.array([[cosine, -sine], [sine, cosine]])


def determinant(jacobian: Array) -> Array:
    """Determinants of the matrices (2, 2, T), (T,)."""
    value: Array = jacobian[0, 0] * jacobian[1, 1] - jacobian[0, 1] * jacobian[1, 0]
    return value


def largest_step(jacobian: Array, change: Array, floor: float | Array) -> Array:
    """Largest a >= 0 such that det(J + x dJ) stays at or above `floor` for all x in [0, a].

    The determinant is a quadratic in x, so the answer is exact.

    Parameters
    ----------
    jacobian, change
        J and dJ of every triangle, (2, 2, T).
    floor
        Smallest determinant allowed; a triangle that starts below it may not fall further.

    Returns
    -------
    ndarray
        Step for each triangle, (T,); infinite where nothing limits it.
    """
    start = determinant(jacobian)
    square = determinant(change)
    slope = (
        jacobian[0, 0] * change[1, 1]
        + jacobian[1, 1] * change[0, 0]
        - jacobian[0, 1] * change[1, 0]
        - jacobian[1, 0] * change[0, 1]
    )
    constant = np.maximum(start - floor, 0.0)
    inner = slope**2 - 4.0 * square * constant
    # The numerically stable form of the smallest positive root of square x^2 + slope x + constant.
    below = -slope + np.sqrt(np.maximum(inner, 0.0))
    step = np.full_like(start, np.inf)
    crosses = (inner >= 0.0) & (below > 0.0)
    np.divide(2.0 * constant, below, out=step, where=crosses)
    return step

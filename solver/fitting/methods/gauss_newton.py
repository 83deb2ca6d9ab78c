"""The linear systems of the default method: Gauss-Newton steps of many domains at once, matrix-free.

The Jacobian of signal d's residual is J_d = -(I - Q_d^T Q_d) G_d W: W maps the vertices' moves to the observations, G_d
are the fitted function's gradients there, and the projection removes what the coefficients compensate (Kaufman 1975).
With L the Laplacian of the initial domain, the move x of the vertices solves

    (sum_d J_d^T J_d + (beta1 + damping) I + beta2 L) x = force.

The result is only a search direction, so single precision suffices, at half the memory traffic.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ..batch import Batch

Singles = NDArray[np.float32]

CONJUGATE_GRADIENT_STEPS = 16

SMALLEST_DETERMINANT = 1e-30
"""Vertices whose 2 x 2 block has a smaller determinant stay: its inverse would not fit into single precision."""

LARGEST_SLOPE = 1e6
"""Systems with steeper functions are divided by its square, which single precision could not hold."""


def gauss_newton_move(
    batch: Batch, orthonormal: Array, gradient: Array, weights: tuple[float, float], damping: Array, force: Array
) -> Array:
    """Take a few preconditioned conjugate-gradient steps on the damped Gauss-Newton systems of all problems.

    Parameters
    ----------
    batch
        The problems.
    orthonormal
        Q: rows that span the weighted functions, (B, D, s, N).
    gradient
        Weighted gradients of the fitted functions at the observations, (2, B, D, N).
    weights
        beta1 and beta2 of eq. 4.
    damping
        Levenberg-Marquardt damping, (B,).
    force
        Right-hand side: half the negative gradient of the energy, (2, B, m).

    Returns
    -------
    ndarray
        Move of the vertices, (2, B, m).
    """
    unit = _units(gradient)
    single = batch.single
    precision = single.observe.dtype
    beta2 = (weights[1] / unit**2).astype(precision)[:, None]
    slopes = (gradient if (unit == 1.0).all() else gradient / unit[:, None, None]).astype(precision)
    rows = orthonormal.astype(precision)
    shift = ((weights[0] + damping) / unit**2).astype(precision)[:, None]

    def apply(move: Singles) -> Singles:
        observed = (single.observe @ move.ravel()).reshape(2, batch.problems, 1, -1)
        change = slopes[0] * observed[0]
        change += slopes[1] * observed[1]
        share = np.matmul(rows, change[..., None])
        change -= np.matmul(share.swapaxes(-1, -2), rows)[..., 0, :]
        forces = np.einsum("cbdn,bdn->cbn", slopes, change)
        back: Singles = (single.collect @ forces.ravel()).reshape(move.shape)
        back += shift * move
        back += beta2 * (single.laplacian @ move.ravel()).reshape(move.shape)
        return back

    precondition = _block_jacobi(batch, slopes, shift + beta2 * single.laplacian_diagonal)
    force = force / (unit**2)[:, None]
    return _conjugate_gradients(apply, precondition, force.astype(precision)).astype(np.float64)


def _units(gradient: Array) -> Array:
    """Unit of each problem's slopes, (B,): one, except for functions far steeper than those of a surface."""
    largest = np.maximum(gradient.max(axis=(0, 2, 3)), -gradient.min(axis=(0, 2, 3)))
    return np.where(largest > LARGEST_SLOPE, largest, 1.0)


def _conjugate_gradients(
    apply: Callable[[Singles], Singles], precondition: Callable[[Singles], Singles], force: Singles
) -> Singles:
    """Run conjugate gradients with a step length for each problem; vectors are (2, B, m)."""

    def dot(a: Singles, b: Singles) -> Singles:
        return np.einsum("cbm,cbm->b", a, b)[:, None]

    def ratio(a: Singles, b: Singles) -> Singles:
        return np.divide(a, b, out=np.zeros_like(a), where=b > 0.0)

    move = np.zeros_like(force)
    residual = force
    direction = precondition(residual)
    slope = dot(residual, direction)
    for _ in range(CONJUGATE_GRADIENT_STEPS):
        applied = apply(direction)
        length = ratio(slope, dot(direction, applied))
        move += length * direction
        residual = residual - length * applied
        preconditioned = precondition(residual)
        following = dot(residual, preconditioned)
        direction = preconditioned + ratio(following, slope) * direction
        slope = following
    return move


def _block_jacobi(batch: Batch, slopes: Singles, shift: Singles) -> Callable[[Singles], Singles]:
    """Inverse of the system's 2 x 2 blocks on the diagonal, without the projection."""
    products = [np.einsum("bdn,bdn->bn", slopes[a], slopes[b]) for a, b in ((0, 0), (0, 1), (1, 1))]
    uu, uv, vv = ((batch.single.diagonal @ product.ravel()).reshape(shift.shape) for product in products)
    uu, vv = uu + shift, vv + shift
    inverse = uu * vv - uv**2
    inverse = np.divide(1.0, inverse, out=np.zeros_like(inverse), where=inverse > SMALLEST_DETERMINANT)
    blocks = np.stack([vv * inverse, -uv * inverse, -uv * inverse, uu * inverse]).reshape(2, 2, *shift.shape)

    def precondition(x: Singles) -> Singles:
        return np.einsum("acbm,cbm->abm", blocks, x)

    return precondition

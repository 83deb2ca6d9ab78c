"""Patches of similar size padded to common 3-D arrays, so that one NumPy call serves many of them.

A *problem* is a domain with the signals that share it: with common domains a patch is one problem with the signals x,
y, z, with separate domains it is three problems with one signal each.  Every problem is moved and scaled, domain and
values by the same factor, so that its initial domain lies in [-1, 1]^2.

The function is observed at the patch's vertices and at its triangles' centroids, through the piecewise linear domain
transformation; without the centroids the surface would oscillate between the vertices.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..arrays import Array, Booleans, Indices
from ..mesh.quadrics import quadric_terms
from .domain_energy import DomainEnergy
from .sparse_matrices import diagonal_blocks, for_both, in_single_precision


@dataclass(frozen=True)
class Problem:
    """One domain with N observations of its D signals, in scene units.

    Each observation lies in one of the domain's triangles: its parameters are a fixed convex combination of those of
    three vertices, however the domain changes.

    Attributes
    ----------
    domain
        Initial domain U0, (m, 2).
    triangles
        (t, 3), numbers of the patch's vertices.
    signals
        Signals at the domain's vertices, (m, D), which determine the problem's frame.
    corners, shares
        Vertices of the triangle of each observation, and its barycentric coordinates, (N, 3) both.
    values
        Observed signals, (N, D).
    weights
        Weights of the observations, (N,).
    degree
        Highest total degree of this problem's functions.
    noise
        Standard deviation of the signals' noise, scene units: functions that explain no more than noise are not used.
    ends_early
        Whether a good fit may end before the regularisation is annealed (see `variable_projection`).
    warm
        Earlier solution from which to start; None: the initial domain and a new choice of functions.
    """

    domain: Array
    triangles: Indices
    signals: Array
    corners: Indices
    shares: Array
    values: Array
    weights: Array
    degree: int
    noise: float = 0.0
    ends_early: bool = False
    warm: WarmStart | None = None


@dataclass(frozen=True)
class WarmStart:
    """A problem's earlier solution: its frame, its domain in that frame (m, 2), and the chosen functions (D, s)."""

    frame: Frame
    domain: Array
    support: Indices


@dataclass(frozen=True)
class Frame:
    """How a problem is moved, turned and scaled: domain = (u - centre) turn scale, values = (b - origin) scale."""

    centre: Array
    turn: Array
    origin: Array
    scale: float

    def put_in(self, domain: Array) -> Array:
        """Parameters (N, 2), given in the patch's own domain, in this frame."""
        inside: Array = (domain - self.centre) @ self.turn * self.scale
        return inside


@dataclass(frozen=True)
class Batch:
    """B padded problems with m vertices, t triangles, N observations and D signals each.

    Attributes
    ----------
    frames
        Frame of each problem.
    sizes
        Number of real vertices of each problem, (B,).
    start
        Initial domains, (2, B, m).
    values
        Observed values, (B, D, N).
    root_weights
        Square roots of the observation weights, (B, 1, N); zero on padding.
    degrees
        Highest total degree of each problem, (B,).
    noise
        Variance of the weighted observations, in the problems' frames, (B,).
    end_early
        Which problems may end early, (B,).
    triangles
        Triangles of all domains, as numbers of the flattened vertices, (B t, 3).
    energy
        Regularisation of all domains, on the flattened vertices.
    observe, collect
        Sparse matrix W from vertices to observations, (B N, B m), for u and v at once, and its transpose.
    """

    frames: list[Frame]
    sizes: Indices
    start: Array
    values: Array
    root_weights: Array
    degrees: Indices
    noise: Array
    end_early: Booleans
    triangles: Indices
    energy: DomainEnergy
    observe: sp.csr_matrix
    collect: sp.csr_matrix

    @property
    def problems(self) -> int:
        """Number of problems, B."""
        return len(self.sizes)

    def only(self, which: Indices) -> Batch:
        """The problems `which` as a batch of their own, padded as before."""
        start, faces = self.start[:, which], len(self.triangles) // self.problems
        moved = start.shape[2] * (np.arange(len(which)) - which)
        triangles = self.triangles.reshape(self.problems, faces, 3)[which] + moved[:, None, None]
        observe = diagonal_blocks(self.observe, 2 * self.problems, np.concatenate([which, self.problems + which]))
        flat = triangles.reshape(-1, 3)
        return Batch(
            [self.frames[k] for k in which],
            self.sizes[which],
            start,
            self.values[which],
            self.root_weights[which],
            self.degrees[which],
            self.noise[which],
            self.end_early[which],
            flat,
            DomainEnergy.of(start.reshape(2, -1), flat),
            observe,
            observe.T.tocsr(),
        )

    def by_problem(self, flat: Array) -> Array:
        """View an array over flattened vertices, triangles or observations (..., B x) as (..., B, x)."""
        return flat.reshape(*flat.shape[:-1], self.problems, -1)

    def observed(self, domain: Array) -> Array:
        """Parameters of the observations, (2, B, N), from those of the vertices, (2, B, m)."""
        return (self.observe @ domain.ravel()).reshape(2, self.problems, -1)

    def collected(self, forces: Array) -> Array:
        """Sum forces on the observations, (2, B, N), at the vertices, (2, B, m), by W^T."""
        return (self.collect @ forces.ravel()).reshape(2, self.problems, -1)

    @cached_property
    def single(self) -> SinglePrecision:
        """The matrices of the Gauss-Newton systems, in single precision."""
        laplacian = in_single_precision(self.energy.laplacian())
        collect = in_single_precision(self.collect)
        squared = collect[: collect.shape[0] // 2, : collect.shape[1] // 2].copy()
        squared.data **= 2
        return SinglePrecision(
            in_single_precision(self.observe),
            collect,
            squared,
            for_both(laplacian),
            laplacian.diagonal().reshape(self.problems, -1),
        )


@dataclass(frozen=True)
class SinglePrecision:
    """Matrices of a batch in single precision.

    Attributes
    ----------
    observe, collect
        As in `Batch`.
    diagonal
        Transpose of W with squared entries, for one coordinate, (B m, B N).
    laplacian
        Laplacian of the initial domains, for both coordinates, (2 B m, 2 B m).
    laplacian_diagonal
        Its diagonal for one coordinate, (B, m).
    """

    observe: sp.csr_matrix
    collect: sp.csr_matrix
    diagonal: sp.csr_matrix
    laplacian: sp.csr_matrix
    laplacian_diagonal: NDArray[np.float32]


def build_batch(problems: list[Problem], turn: bool = True) -> Batch:
    """Pad problems to common sizes and transform them to their frames, turned to their principal axes if `turn`."""
    frames = [problem.warm.frame if problem.warm else frame_of(problem, turn) for problem in problems]
    count, most = len(problems), max(len(problem.domain) for problem in problems)
    faces = max(len(problem.triangles) for problem in problems)
    observations = max(len(problem.values) for problem in problems)
    signals = problems[0].values.shape[1]
    start = np.zeros((2, count, most))
    values = np.zeros((count, signals, observations))
    weights = np.zeros((count, 1, observations))
    triangles = np.zeros((count, faces, 3), dtype=np.int64)
    for k, (problem, frame) in enumerate(zip(problems, frames, strict=True)):
        start[:, k, : len(problem.domain)] = frame.put_in(problem.domain).T
        triangles[k, : len(problem.triangles)] = problem.triangles
        values[k, :, : len(problem.values)] = ((problem.values - frame.origin) * frame.scale).T
        weights[k, 0, : len(problem.weights)] = problem.weights
    flat = (triangles + most * np.arange(count)[:, None, None]).reshape(-1, 3)
    observe = for_both(_observation_matrix(problems, most, observations))
    energy = DomainEnergy.of(start.reshape(2, -1), flat)
    return Batch(
        frames,
        np.array([len(problem.domain) for problem in problems]),
        start,
        values,
        np.sqrt(weights),
        np.array([problem.degree for problem in problems]),
        np.array([_weighted_noise(problem, frame) for problem, frame in zip(problems, frames, strict=True)]),
        np.array([problem.ends_early for problem in problems]),
        flat,
        energy,
        observe,
        observe.T.tocsr(),
    )


def _weighted_noise(problem: Problem, frame: Frame) -> float:
    """Variance of the noise along a weighted function: the mean over the observations, weighted by their weights."""
    total = float(problem.weights.sum())
    share = float((problem.weights**2).sum()) / total if total > 0.0 else 0.0
    return (problem.noise * frame.scale) ** 2 * share


def warm_starts(problems: list[Problem], start: Array) -> tuple[Array, Indices]:
    """Domains (2, B, m) and functions (B, D, s) of the problems' earlier solutions; every problem must have one."""
    domains = start.copy()
    warm = [problem.warm for problem in problems if problem.warm is not None]
    support = np.full((len(problems), *np.max([one.support.shape for one in warm], axis=0)), -1, dtype=np.int64)
    for k, (problem, one) in enumerate(zip(problems, warm, strict=True)):
        domains[:, k, : len(problem.domain)] = one.domain.T
        support[k, :, : one.support.shape[1]] = one.support
    return domains, support


def frame_of(problem: Problem, turn: bool = True) -> Frame:
    """Frame that puts a problem's initial domain into [-1, 1]^2, turned to the signals' principal axes if `turn`."""
    axes = principal_axes(problem.domain, problem.signals) if turn else np.eye(2)
    turned = problem.domain @ axes
    low, high = turned.min(axis=0), turned.max(axis=0)
    reach = float((high - low).max()) / 2.0
    centre = (low + high) / 2.0 @ axes.T
    return Frame(centre, axes, problem.signals.mean(axis=0), 1.0 / reach if reach > 0.0 else 1.0)


def principal_axes(domain: Array, values: Array) -> Array:
    """Rotation (2, 2) whose columns are the directions in which the signals bend most and least.

    A quadratic is fitted to each signal; the axes are the eigenvectors of the sum of the squared Hessians.  Products of
    one-variable polynomials need far fewer terms for a crease that runs along an axis.
    """
    centred = domain - domain.mean(axis=0)
    reach = np.abs(centred).max()
    if reach == 0.0:
        return np.eye(2)
    u, v = centred.T / reach
    quadratic = np.linalg.lstsq(quadric_terms(u, v, axis=1), values, rcond=1e-8)[0]
    hessians = np.array([[2 * quadratic[3], quadratic[4]], [quadratic[4], 2 * quadratic[5]]])
    _, axes = np.linalg.eigh(np.einsum("abd,bcd->ac", hessians, hessians))
    axes = axes[:, ::-1]
    # The sign of an eigenvector is arbitrary: point the first one right, and keep the orientation.
    if axes[0, 0] < 0.0 or (axes[0, 0] == 0.0 and axes[1, 0] < 0.0):
        axes = -axes
    if np.linalg.det(axes) < 0.0:
        axes[:, 1] = -axes[:, 1]
    # The memory layout decides how products are rounded; this one survives the transfer to another process.
    return np.ascontiguousarray(axes)


def _observation_matrix(problems: list[Problem], vertices: int, observations: int) -> sp.csr_matrix:
    """W of all problems, each padded to the given numbers of vertices and observations."""
    shares = np.zeros((len(problems), observations, 3))
    corners = np.zeros((len(problems), observations, 3), dtype=np.int64)
    for k, problem in enumerate(problems):
        shares[k, : len(problem.shares)] = problem.shares
        corners[k, : len(problem.corners)] = problem.corners + vertices * k
    some = shares != 0.0
    starts = np.concatenate([[0], np.cumsum(np.count_nonzero(some, axis=2).ravel())])
    shape = (len(problems) * observations, len(problems) * vertices)
    return sp.csr_matrix((shares[some], corners[some], starts), shape=shape)

"""Section 3 of the paper: scalar data over one patch, fitted by any of the methods."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from sparse_surface.solver import Settings
from sparse_surface.solver.fitting.batch import Problem, build_batch
from sparse_surface.solver.fitting.dictionary import Dictionary
from sparse_surface.solver.fitting.domain_energy import DomainEnergy, determinant
from sparse_surface.solver.fitting.methods import solver_of
from sparse_surface.solver.patch_methods import METHODS

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Height = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Patch:
    """Scalar data over a planar triangulation: parameters (m, 2), triangles (t, 3), values (m,)."""

    domain: Array
    triangles: Indices
    values: Array


@dataclass(frozen=True)
class Fitted:
    """A patch after a method was done with it.

    Attributes
    ----------
    start, domain
        Initial and optimised parameters, (m, 2).
    values
        Of the representation at the vertices, (m,).
    dictionary, support, coefficients
        The sparse polynomial.
    energy, rms
        After each iteration.
    seconds
        Of processor time.
    polynomial
        h: parameters (n, 2) -> values (n,).
    """

    patch: Patch
    start: Array
    domain: Array
    values: Array
    dictionary: Dictionary
    support: Indices
    coefficients: Array
    energy: list[float]
    rms: list[float]
    seconds: float
    polynomial: Callable[[Array], Array]

    @property
    def error(self) -> Array:
        return np.abs(self.values - self.patch.values)

    @property
    def final_rms(self) -> float:
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def flips(self) -> int:
        energy = DomainEnergy.of(self.start.T.copy(), self.patch.triangles)
        return int((determinant(energy.jacobian(self.domain.T)) < 0.0).sum())


def grid_patch(height: Height, side: int = 21, seed: int = 3) -> Patch:
    """Return data over a jittered square grid on [-1, 1]^2."""
    rng = np.random.default_rng(seed)
    row, column = np.divmod(np.arange(side * side), side)
    step = 2.0 / (side - 1)
    inside = np.column_stack([(column > 0) & (column < side - 1), (row > 0) & (row < side - 1)])
    points = np.column_stack((column, row)) * step - 1.0 + rng.uniform(-0.2, 0.2, (side * side, 2)) * step * inside
    number = np.arange(side * side).reshape(side, side)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    other = (row + column)[a] % 2 == 1
    one = np.where(other[:, None], np.column_stack((a, b, c)), np.column_stack((a, b, d)))
    two = np.where(other[:, None], np.column_stack((a, c, d)), np.column_stack((b, c, d)))
    return Patch(points, np.concatenate([one, two]), height(*points.T))


def smooth(u: Array, v: Array) -> Array:
    """A broad hill on a saddle."""
    hill: Array = 0.5 * np.exp(-0.9 * (u - 0.2) ** 2 - 0.8 * v**2)
    return hill + 0.12 * u * v


def bent_crease(u: Array, v: Array) -> Array:
    """Two smooth sheets that meet in a curved crease which runs aslant."""
    across = 0.8 * u + 0.6 * v - 0.25 * (0.6 * u - 0.8 * v) ** 2 + 0.08
    return 0.45 - 0.75 * np.abs(across) + 0.12 * np.sin(2.0 * u)


def fit(patch: Patch, settings: Settings) -> Fitted:
    """Fit a patch with the method of the settings."""
    settings = settings.resolved()
    count = len(patch.domain)
    signals = patch.values[:, None]
    corners, shares = np.repeat(np.arange(count), 3).reshape(-1, 3), np.tile([1.0, 0.0, 0.0], (count, 1))
    weights = np.ones(count)
    if settings.observations == "centroids":
        corners = np.concatenate([corners, patch.triangles])
        shares = np.concatenate([shares, np.full(patch.triangles.shape, 1.0 / 3.0)])
        weights = np.concatenate([weights, np.full(len(patch.triangles), 0.5)])
    observed = (signals[corners, 0] * shares).sum(axis=1)[:, None]
    problem = Problem(patch.domain, patch.triangles, signals, corners, shares, observed, weights, settings.degree)
    begin = time.process_time()
    batch = build_batch([problem], turn=METHODS[settings.method].turns_domain)
    dictionary = Dictionary(settings.degree, settings.basis)
    solution = solver_of(settings).solve(batch, dictionary, settings)
    seconds = time.process_time() - begin
    frame = batch.frames[0]
    back = frame.turn.T / frame.scale
    into = np.linalg.inv(back)

    def polynomial(points: Array) -> Array:
        at = (points @ into).T[:, None, None]
        values: Array = dictionary.sparse_values(solution.support, solution.coefficients, at)[0, 0]
        return values / frame.scale + frame.origin[0]

    domain = solution.domain[:, 0].T @ back
    return Fitted(
        patch,
        batch.start[:, 0].T @ back,
        domain,
        polynomial(domain),
        dictionary,
        solution.support[0, 0],
        solution.coefficients[0, 0],
        [float(energy[0]) for energy in solution.trace.energy],
        [float(np.sqrt(squares[0] / len(observed)) / frame.scale) for squares in solution.trace.squared_error],
        seconds,
        polynomial,
    )


def iterates(patch: Patch, settings: Settings, numbers: list[int]) -> list[Fitted]:
    """Return the state of the method after a number of iterations; every call takes the same path."""
    return [fit(patch, replace(settings, iterations=number)) for number in numbers]

"""The paper's own method: the augmented-Lagrangian iteration of section 3.3 (eq. 5, steps 1 to 4).

Each iteration updates four variables in turn, with the others held:

1. the sparse coefficients c, by orthogonal matching pursuit on f + lambda / rho;
2. the domain U = argmin rho/2 sum (f - h(u) + lambda / rho)^2 + Q(U), by L-BFGS-B with the analytic gradient, one patch
   at a time as in the paper (which lets dlib's BFGS difference the function);
3. the auxiliary values f = (2 b + rho a) / (2 + rho) with a = h(u) - lambda / rho;
4. the multipliers lambda += tau rho (f - h(u)).

With the printed settings the iteration does not converge within 15 steps, since the multipliers accumulate what no 15
functions can represent; therefore each problem keeps its best iterate.

Observation weights w, which eq. 6 introduces (1 / n_p^2), multiply every square.  That is the printed iteration with
the surface itself, what the other patches contribute plus h_k / n_p, for f; step 3 stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from ...arrays import Array, Booleans, Indices
from ...settings import Settings
from ..batch import Batch
from ..dictionary import Dictionary, coefficient_grid
from ..domain_energy import DomainEnergy
from ..solution import Solution, Trace
from ..sparse_fit import Fit, as_wide_as, least_squares, merge, select

STOP_CHANGE = 1e-6
"""A problem stops when the root mean square of its misfit changes by less, in its frame (half width 1)."""

MINIMISER = {"maxiter": 60, "ftol": 1e-8, "gtol": 0.0, "maxcor": 12}
"""Limits and memory of the quasi-Newton minimisation in step 2."""


def solve(batch: Batch, dictionary: Dictionary, settings: Settings) -> Solution:
    """Run the iteration from the initial domains, lambda = 0 and the f that `settings.initial_fit` names.

    Parameters
    ----------
    batch
        Padded problems.
    dictionary
        Basis functions.
    settings
        `sparsity`, `pursuit`, `iterations`, `beta1`, `beta2`, `rho`, `tau`, and the readings `initial_fit`,
        `regularisation` and `rigidity_reference`.
    """
    f = np.zeros_like(batch.values) if settings.initial_fit == "zero" else batch.values
    iteration = Iteration(batch, dictionary, settings, batch.start, f)
    return iteration.run(settings.iterations)


def improve(
    batch: Batch, dictionary: Dictionary, settings: Settings, domain: Array, support: Indices, iterations: int
) -> Solution:
    """Continue from an earlier solution, domains (2, B, m) and functions (B, D, s), with f = b.

    This updates the pair (c_k, U_k) of each problem in the Gauss-Seidel solver of eq. 6.  The earlier solution with
    refitted coefficients counts as an iterate: no problem ends with more energy than that.
    """
    iteration = Iteration(batch, dictionary, settings, domain, batch.values)
    iteration.take(least_squares(batch, dictionary, domain, as_wide_as(iteration.fit, support)))
    return iteration.run(iterations)


class Iteration:
    """The variables c, U, f and lambda of every problem, and each problem's best iterate so far.

    Attributes
    ----------
    domain
        U, (2, B, m).
    f, multipliers
        At the observations, (B, D, N).
    fit
        The sparse coefficients of the last step 1.
    energy
        Objective of eq. 3 at the last iterate, (B,).
    """

    def __init__(self, batch: Batch, dictionary: Dictionary, settings: Settings, domain: Array, f: Array) -> None:
        self.batch, self.dictionary, self.settings = batch, dictionary, settings
        self.domain, self.f, self.multipliers = domain, f, np.zeros_like(f)
        share = 1.0 / batch.sizes if settings.regularisation == "vertex" else np.ones(batch.problems)
        self.weights = settings.beta1 * share, settings.beta2 * share
        self.rigidity = batch.energy
        self._refer_rigidity()
        self.fit = select(batch, dictionary, domain, settings.sparsity, settings.pursuit)
        self.energy = self.misfit = self.best_energy = np.full(batch.problems, np.inf)
        self.best_domain, self.best_fit = domain, self.fit
        self._alone: dict[int, Batch] = {}

    def run(self, iterations: int) -> Solution:
        """Iterate until nothing changes, and return the best iterates."""
        trace = Trace(self.settings.keep_iterations)
        running = np.ones(self.batch.problems, dtype=bool)
        for _ in range(iterations):
            if running.any():
                before = self.misfit
                self.step(running)
                running = running & ~(np.abs(self.misfit - before) < STOP_CHANGE)
            self._note(trace)
        if iterations == 0:
            self.take(self.fit)
            self._note(trace)
        return Solution(self.best_domain, self.best_fit.support, self.best_fit.coefficients, trace)

    def step(self, running: Booleans) -> None:
        """Steps 1 to 4 for the problems that are running."""
        settings = self.settings
        fit = self.choose()
        domain = self.move(fit, running)
        fitted = self.fitted(domain, fit)
        f = closed_form_f(self.batch.values, fitted, self.multipliers, settings.rho)
        multipliers = self.multipliers + settings.tau * settings.rho * (f - fitted)
        self.domain = np.where(running[:, None], domain, self.domain)
        self.f = np.where(running[:, None, None], f, self.f)
        self.multipliers = np.where(running[:, None, None], multipliers, self.multipliers)
        self.take(merge(running, fit, self.fit), running)
        self._refer_rigidity()

    def choose(self) -> Fit:
        """Step 1: at most s functions for f + lambda / rho over the present domains."""
        target = replace(self.batch, values=self.target)
        return select(target, self.dictionary, self.domain, self.settings.sparsity, self.settings.pursuit)

    def move(self, fit: Fit, running: Booleans) -> Array:
        """Step 2: domains, (2, B, m), for given coefficients; those of problems that have stopped stay."""
        domain, objective = self.domain.copy(), self.objective(fit)
        for k in map(int, np.flatnonzero(running)):
            if k not in self._alone:
                self._alone[k] = self.batch.only(np.array([k]))
            own = objective.only(k, self._alone[k])
            with np.errstate(over="ignore", invalid="ignore"):  # a step that is far too long
                found = minimize(own.of_one, domain[:, k].ravel(), jac=True, method="L-BFGS-B", options=MINIMISER)
            domain[:, k] = found.x.reshape(2, -1)
        return domain

    def objective(self, fit: Fit) -> DomainObjective:
        """What step 2 minimises."""
        degrees, degree = self.dictionary.degrees, self.dictionary.degree
        grid = coefficient_grid(degrees, fit.support, fit.coefficients, degree)
        return DomainObjective(
            self.batch, self.dictionary, grid, self.target, self.settings.rho / 2.0, self.weights, self.rigidity
        )

    @property
    def target(self) -> Array:
        """What steps 1 and 2 fit, f + lambda / rho, (B, D, N)."""
        return self.f + self.multipliers / self.settings.rho

    def fitted(self, domain: Array, fit: Fit) -> Array:
        """Values of the fit at the observations, (B, D, N)."""
        return self.dictionary.sparse_values(fit.support, fit.coefficients, self.batch.observed(domain)[:, :, None])

    def residual(self, fit: Fit) -> Array:
        """Weighted misfit of the data at the observations, (B, D, N)."""
        return (self.batch.values - self.fitted(self.domain, fit)) * self.batch.root_weights

    def take(self, fit: Fit, running: Booleans | None = None) -> None:
        """Note the present domains with `fit` as iterate, the best one of a problem where its energy is lowest."""
        residual = self.residual(fit)
        squares = np.einsum("bdn,bdn->b", residual, residual)
        energy = squares + self.objective(fit).regularisation(self.domain)[0]
        running = np.ones(len(energy), dtype=bool) if running is None else running
        self.energy = np.where(running, energy, self.energy)
        self.misfit = np.sqrt(squares / self.batch.sizes)
        better = self.energy < self.best_energy
        self.best_energy = np.where(better, self.energy, self.best_energy)
        self.best_domain = np.where(better[:, None], self.domain, self.best_domain)
        self.best_fit = merge(better, fit, self.best_fit)
        self.fit = fit

    def _note(self, trace: Trace) -> None:
        fit = self.fit
        trace.note(
            self.batch, self.energy, self.residual(fit), self.dictionary, fit.support, fit.coefficients, self.domain
        )

    def _refer_rigidity(self) -> None:
        """Measure Q2 from the present domains, where that is the reading."""
        if self.settings.rigidity_reference == "previous":
            self.rigidity = DomainEnergy.of(self.domain.reshape(2, -1), self.batch.triangles)


@dataclass(frozen=True)
class DomainObjective:
    """Objective of step 2 for every problem of a batch, with its gradient.

    Attributes
    ----------
    grid
        Coefficients over the grid of degrees, (B, D, t + 1, t + 1).
    target
        f + lambda / rho, (B, D, N).
    half_rho
        Factor of the squares.
    weights
        beta1 and beta2 of every problem, 2 arrays (B,).
    rigidity
        Q2, from the initial domain or the previous iterate.
    """

    batch: Batch
    dictionary: Dictionary
    grid: Array
    target: Array
    half_rho: float
    weights: tuple[Array, Array]
    rigidity: DomainEnergy

    def __call__(self, points: Array) -> tuple[Array, Array]:
        """Values (B,) and gradients (B, 2 m) at flattened domains (B, 2 m)."""
        batch = self.batch
        domain = points.reshape(batch.problems, 2, -1).swapaxes(0, 1)
        u, v = (self.dictionary.tables(x)[:, None] for x in batch.observed(domain))
        across = np.matmul(self.grid, v)
        residual = (u * across).sum(axis=-2) - self.target
        along_u = (self.dictionary.derivative_tables(u) * across).sum(axis=-2)
        along_v = (u * np.matmul(self.grid, self.dictionary.derivative_tables(v))).sum(axis=-2)
        weighted = batch.root_weights**2 * residual
        force = np.stack([(along_u * weighted).sum(axis=1), (along_v * weighted).sum(axis=1)])
        regularisation, gradient = self.regularisation(domain)
        value = self.half_rho * (weighted * residual).sum(axis=(1, 2)) + regularisation
        gradient += 2.0 * self.half_rho * batch.collected(force)
        return value, gradient.swapaxes(0, 1).reshape(batch.problems, -1)

    def of_one(self, point: Array) -> tuple[float, Array]:
        """Value and gradient of a single problem, for SciPy."""
        value, gradient = self(point[None])
        return float(value[0]), gradient[0]

    def only(self, k: int, batch: Batch) -> DomainObjective:
        """The objective of problem k, which `batch` holds alone."""
        rigidity = batch.energy
        if self.rigidity is not self.batch.energy:
            reference = self.rigidity.start.reshape(2, self.batch.problems, -1)[:, k]
            rigidity = DomainEnergy.of(reference, batch.triangles)
        weights = self.weights[0][[k]], self.weights[1][[k]]
        return replace(
            self, batch=batch, grid=self.grid[[k]], target=self.target[[k]], weights=weights, rigidity=rigidity
        )

    def regularisation(self, domain: Array) -> tuple[Array, Array]:
        """Q(U), (B,), and its gradient, (2, B, m), at domains (2, B, m)."""
        batch, flat = self.batch, domain.reshape(2, -1)
        beta1, beta2 = self.weights
        jacobian = self.rigidity.jacobian(flat)
        proximity = batch.by_problem(batch.energy.proximity(flat)).sum(axis=1)
        rigidity = batch.by_problem(self.rigidity.rigidity(jacobian)).sum(axis=1)
        gradient = 2.0 * beta1[:, None] * (domain - batch.start)
        gradient += beta2[:, None] * batch.by_problem(self.rigidity.rigidity_gradient(jacobian))
        return beta1 * proximity + beta2 * rigidity, gradient


def closed_form_f(data: Array, fitted: Array, multipliers: Array, rho: float) -> Array:
    """Step 3: the minimum over f of |b - f|^2 + rho/2 |f - h + lambda / rho|^2."""
    f: Array = (2.0 * data + rho * (fitted - multipliers / rho)) / (2.0 + rho)
    return f

"""What one would assemble from libraries: scikit-learn's `orthogonal_mp` and SciPy's L-BFGS-B, a patch at a time.

It alternates as the paper does: choose sparse coefficients on the current domain, then move the domain with the
coefficients held, against the same regularisation.  Compared with the default solver on the same patches, both with
uniform weights.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from sklearn.linear_model import orthogonal_mp

from ..solver import Settings
from ..solver.fitting.batch import Batch, Problem, build_batch
from ..solver.fitting.chunks import chunk_patches, chunk_task, fit_chunk
from ..solver.fitting.dictionary import Dictionary
from ..solver.mesh.triangle_mesh import build_mesh
from ..solver.patches.blending import blending_weights
from ..solver.patches.cover import build_cover
from ..solver.patches.observations import MeshObservations
from ..solver.patches.patches import build_patches
from ..solver.patches.splitting import with_domains
from .cases import Case, generated, unit_seconds

Array = NDArray[np.float64]

ITERATIONS = 15
STEPS_EACH = 20


@dataclass(frozen=True)
class Comparison:
    """Both on the same patches: units for one patch, and rms errors divided by the model's longest side."""

    model: str
    patches: int
    alternative_units: float
    alternative_vertex_rms: float
    alternative_inside_rms: float
    units: float
    vertex_rms: float
    inside_rms: float


def compare(case: Case, patches: int = 16) -> Comparison:
    """Fit some patches of a model both ways; meant to run in a process of its own, like `cases.run_case`."""
    vertices, faces = case.arrays if case.arrays is not None else generated(case.model, case.size)
    settings = Settings(**{**case.settings, "blending": "uniform"}).resolved()
    mesh = build_mesh(np.asarray(vertices, dtype=np.float64), faces)
    cover, domains = with_domains(mesh, build_patches(mesh, build_cover(mesh, settings.ring), settings.ring), settings)
    blend = blending_weights(mesh, cover, settings.blending)
    observations = MeshObservations(mesh, cover, blend, settings.blending)
    which = np.linspace(0, len(cover) - 1, patches).astype(np.int64)
    tasks = [chunk_task(observations, domains, settings, chunk) for chunk in chunk_patches(observations, which)]
    size = float(np.ptp(vertices, axis=0).max())
    unit = unit_seconds()

    start = time.perf_counter()
    fits = [fit for task in tasks for fit in fit_chunk(task)]
    own_time = time.perf_counter() - start
    problems = [problem for task in tasks for problem in task.problems]
    own = [_errors(p, fit.values) for p, fit in zip(problems, fits, strict=True)]

    start = time.perf_counter()
    values = [fit_by_libraries(problem, settings) for problem in problems]
    other_time = time.perf_counter() - start
    other = [_errors(p, v) for p, v in zip(problems, values, strict=True)]
    return Comparison(
        case.model,
        len(problems),
        other_time / unit / len(problems),
        _rms([at_vertices for at_vertices, _ in other]) / size,
        _rms([inside for _, inside in other]) / size,
        own_time / unit / len(problems),
        _rms([at_vertices for at_vertices, _ in own]) / size,
        _rms([inside for _, inside in own]) / size,
    )


def _errors(problem: Problem, values: Array) -> tuple[Array, Array]:
    """Distances at the patch's vertices and at its triangles' centroids."""
    distance = np.linalg.norm(values - problem.values, axis=1)
    return distance[: len(problem.domain)], distance[len(problem.domain) :]


def _rms(distances: list[Array]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(distances) ** 2)))


def fit_by_libraries(problem: Problem, settings: Settings) -> Array:
    """Fit one patch; returns its values at the problem's observations, (N, 3), scene units."""
    batch = build_batch([problem])
    dictionary = Dictionary(min(settings.degree, problem.degree), settings.basis)
    count, frame = len(problem.domain), batch.frames[0]
    signals = batch.values[0, :, :count]
    domain = batch.start[:, 0]
    for _ in range(ITERATIONS):
        functions = dictionary.evaluate(domain).T
        norm = np.linalg.norm(functions, axis=0)
        coefficients = orthogonal_mp(
            functions / norm, signals.T, n_nonzero_coefs=min(settings.sparsity, count), precompute=True
        )
        coefficients = (coefficients.T / norm).reshape(3, -1)
        domain = _moved(batch, dictionary, coefficients, signals, domain, settings)
    observed = batch.observed(domain[:, None])[:, 0]
    values: Array = (coefficients @ dictionary.evaluate(observed)).T / frame.scale + frame.origin
    return values


def _moved(
    batch: Batch, dictionary: Dictionary, coefficients: Array, signals: Array, domain: Array, settings: Settings
) -> Array:
    """The domain after some steps of L-BFGS-B on eq. 3 with the coefficients held."""
    i, j = dictionary.degrees.T
    energy = batch.energy

    def objective(flat: Array) -> tuple[float, Array]:
        moved = flat.reshape(2, -1)
        u, v = (dictionary.tables(x) for x in moved)
        residual = coefficients @ (u[i] * v[j]) - signals
        along_u = coefficients @ (dictionary.derivative_tables(u)[i] * v[j])
        along_v = coefficients @ (u[i] * dictionary.derivative_tables(v)[j])
        jacobian = energy.jacobian(moved)
        value = (residual**2).sum() + settings.beta1 * energy.proximity(moved).sum()
        value += settings.beta2 * energy.rigidity(jacobian).sum()
        slope = 2.0 * np.stack([(residual * along_u).sum(axis=0), (residual * along_v).sum(axis=0)])
        slope += 2.0 * settings.beta1 * (moved - energy.start) + settings.beta2 * energy.rigidity_gradient(jacobian)
        return float(value), slope.ravel()

    found: Any = minimize(objective, domain.ravel(), jac=True, method="L-BFGS-B", options={"maxiter": STEPS_EACH})
    moved: Array = found.x.reshape(2, -1)
    return moved

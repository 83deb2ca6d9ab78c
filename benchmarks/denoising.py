"""How close denoising comes to the clean mesh."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..solver import Settings, approximate, denoise
from ..solver.mesh.triangulation import triangulate
from ..solver.surface.metrics import normal_error
from .bilateral import filtered
from .cases import Case, alone, generated, unit_seconds
from .tables import Table

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SHARES = {"fandisk": (0.001, 0.003, 0.01), "bunny": (0.001, 0.003), "cube": (0.003,)}
"""Deviation of the noise along the vertex normals, in shares of the bounding box's diagonal."""

ISOTROPIC = {"fandisk": (0.003,)}
"""The same for noise in all directions, the root mean square of its length."""

CLEAN = ("fandisk", "bunny", "cube", "sphere")
SEEDS = (1001, 1002, 1003)
"""No constant of the solver was chosen on these."""


@dataclass(frozen=True)
class NoisyCase:
    """A model with noise on it."""

    case: Case
    share: float
    isotropic: bool = False
    seeds: Sequence[int] = SEEDS


@dataclass(frozen=True)
class Closeness:
    """Distance from the clean mesh: rms at the vertices in longest sides, mean angle of face normals in degrees."""

    rms: float
    degrees: float


@dataclass(frozen=True)
class DenoisedCase:
    """The measurements of a noisy model: the means over the seeds, and the worst.

    Attributes
    ----------
    noisy, denoised, worst, fitted
        Before, after, the worst seed after, and after the representation is fitted to the first seed.
    peer
        The tuned bilateral normal filter on the first seed: its best rms and its best angle, perhaps of two settings.
    level
        The noise that was found over that which was put on, where it was along the normals.
    units
        Time of denoising in units, without the fit.
    """

    model: str
    share: float
    isotropic: bool
    noisy: Closeness
    denoised: Closeness
    worst: Closeness
    fitted: Closeness
    peer: Closeness
    level: float
    units: float


def run(cases: Sequence[Case], say: Callable[[str], None]) -> tuple[dict[str, Table], Any]:
    """Measure denoising on these models, with noise and without; returns two tables, and everything as plain values."""
    results: list[DenoisedCase] = []
    for noisy in noisy_cases(cases):
        say(f"{noisy.case.model}, noise {noisy.share:.1%}{', all directions' * noisy.isotropic}")
        results.append(alone(measure_noisy, noisy))
    clean: dict[str, tuple[bool, float]] = {}
    chosen = [case for case in cases if case.model in CLEAN]
    if any(case.model == "cube" for case in chosen) and all(case.model != "sphere" for case in chosen):
        chosen.append(Case("sphere"))
    for case in chosen:
        say(f"{case.model}, without noise")
        clean[case.model] = alone(measure_clean, case)
    values = {
        "noisy": [asdict(each) for each in results],
        "clean": {model: {"unchanged": same, "units": units} for model, (same, units) in clean.items()},
    }
    return tables(results, clean), values


def noisy_cases(cases: Sequence[Case]) -> list[NoisyCase]:
    """Which noise is put on which model."""
    along = [NoisyCase(case, share) for case in cases for share in SHARES.get(case.model, ())]
    everywhere = [NoisyCase(case, share, True) for case in cases for share in ISOTROPIC.get(case.model, ())]
    return along + everywhere


def measure_noisy(noisy: NoisyCase) -> DenoisedCase:
    """Denoise a model with noise from several seeds; meant to run in a process of its own."""
    vertices, triangles = _arrays(noisy.case)
    before, after, levels, times = [], [], [], []
    for seed in noisy.seeds:
        given = with_noise(vertices, triangles, noisy.share, seed, noisy.isotropic)
        unit = unit_seconds(5)
        start = time.perf_counter()
        denoised = denoise(given, triangles)
        seconds = time.perf_counter() - start
        times.append(seconds / (0.5 * (unit + unit_seconds(5))))
        levels.append(denoised.estimated_noise_level / (noisy.share * _diagonal(vertices)))
        before.append(closeness(vertices, triangles, given))
        after.append(closeness(vertices, triangles, denoised.vertices))
    first = with_noise(vertices, triangles, noisy.share, noisy.seeds[0], noisy.isotropic)
    peers = [closeness(vertices, triangles, each) for each in filtered(first, triangles)]
    fitted = approximate(first, triangles, Settings(**{**noisy.case.settings, "denoise": "first", "workers": 1}))
    return DenoisedCase(
        noisy.case.model,
        noisy.share,
        noisy.isotropic,
        _mean(before),
        _mean(after),
        Closeness(max(each.rms for each in after), max(each.degrees for each in after)),
        closeness(vertices, triangles, fitted.vertices),
        Closeness(min(each.rms for each in peers), min(each.degrees for each in peers)),
        float(np.mean(levels)),
        float(np.mean(times)),
    )


def measure_clean(case: Case) -> tuple[bool, float]:
    """Return whether a clean model comes back bit for bit, and the units that took."""
    vertices, triangles = _arrays(case)
    start = time.perf_counter()
    denoised = denoise(vertices, triangles)
    seconds = time.perf_counter() - start
    return denoised.vertices.tobytes() == vertices.tobytes(), seconds / unit_seconds(5)


def with_noise(vertices: Array, triangles: Indices, share: float, seed: int, isotropic: bool) -> Array:
    """Return the vertices with Gaussian noise of `share` of the diagonal, along vertex normals or in all directions."""
    rng = np.random.default_rng(seed)
    level = share * _diagonal(vertices)
    if isotropic:
        return vertices + rng.normal(0.0, level / np.sqrt(3.0), vertices.shape)
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    crossed = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    normals = np.stack([np.bincount(triangles.ravel(), column, len(vertices)) for column in crossed.T], axis=1)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return vertices + normals * rng.normal(0.0, level, len(vertices))[:, None]


def closeness(clean: Array, triangles: Indices, vertices: NDArray[Any]) -> Closeness:
    """Return how far vertices, (V, 3), are from the clean ones."""
    points = np.asarray(vertices, dtype=np.float64)
    used = np.unique(triangles)
    size = float(np.ptp(clean[used], axis=0).max())
    rms = float(np.sqrt(np.mean(np.sum((points[used] - clean[used]) ** 2, axis=1)))) / size
    return Closeness(rms, normal_error(clean, points, triangles))


def tables(results: Sequence[DenoisedCase], clean: dict[str, tuple[bool, float]]) -> dict[str, Table]:
    """Return what was measured: models with noise, and models without."""
    head = ["model", "noise", "noisy", "denoised", "worst seed", "bilateral filter", "then fitted", "level found"]
    rows = [
        [
            each.model,
            f"{each.share:.1%}" + (", all directions" if each.isotropic else ""),
            *(_figures(found) for found in (each.noisy, each.denoised, each.worst, each.peer, each.fitted)),
            "" if each.isotropic else f"{each.level:.0%}",
            each.units,
        ]
        for each in results
    ]
    unharmed = [[model, "unchanged" if same else "changed", units] for model, (same, units) in clean.items()]
    return {
        "denoising": Table.of([*head, "units"], rows),
        "denoising, clean": Table.of(["model", "comes back", "units"], unharmed),
    }


def _figures(found: Closeness) -> str:
    return f"{found.rms:.2e} / {found.degrees:.2f}"


def _mean(found: Sequence[Closeness]) -> Closeness:
    return Closeness(float(np.mean([each.rms for each in found])), float(np.mean([each.degrees for each in found])))


def _diagonal(vertices: Array) -> float:
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


def _arrays(case: Case) -> tuple[Array, Indices]:
    """Vertices that faces use, and triangles."""
    vertices, faces = case.arrays if case.arrays is not None else generated(case.model, case.size)
    points = np.asarray(vertices, dtype=np.float64)
    triangles, _ = triangulate(points, np.ravel(faces), np.arange(len(faces) + 1) * faces.shape[1])
    return points, triangles

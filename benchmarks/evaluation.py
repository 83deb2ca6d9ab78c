"""The representation as something to keep: its size, how fast and how smoothly it evaluates."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..solver import Settings, approximate
from ..solver.surface.representation import Representation
from .cases import Case, alone, generated, unit_seconds
from .smoothness import bends
from .tables import Table

MODELS = ("cube", "fandisk", "bunny")
POINTS = 1_000_000
SHARES = (0.5, 0.9, 0.99, 1.0)


@dataclass(frozen=True)
class Evaluated:
    """What was measured of one representation.

    Attributes
    ----------
    patches, file_bytes
        Its size.
    point_units, normal_units
        Units of evaluating a million random points, and their normals, on one core.
    change
        Largest distance of the same points after saving and loading, in longest sides.
    angles
        Quantiles of the angles at edges; see `Bends.quantiles`.
    """

    model: str
    patches: int
    file_bytes: int
    point_units: float
    normal_units: float
    change: float
    angles: dict[str, dict[str, list[float]]]


def run(cases: Sequence[Case], say: Callable[[str], None]) -> tuple[dict[str, Table], Any]:
    """Measure; returns two tables, and everything as plain values."""
    results: list[Evaluated] = []
    for case in cases:
        if case.model in MODELS:
            say(f"{case.model}, evaluating a million points")
            results.append(alone(evaluate, case))
    return tables(results), [asdict(each) for each in results]


def evaluate(case: Case, points: int = POINTS) -> Evaluated:
    """Approximate a model and measure its representation; meant to run in a process of its own."""
    vertices, faces = case.arrays if case.arrays is not None else generated(case.model, case.size)
    surface = approximate(vertices, faces, Settings(**{**case.settings, "workers": 1})).representation
    loaded = Representation.from_bytes(surface.stored)
    rng = np.random.default_rng(0)
    face, inside = rng.integers(0, len(surface.triangles), points), rng.dirichlet([1.0, 1.0, 1.0], points)
    surface.evaluate(face[:10], inside[:10])  # what is prepared once
    before = unit_seconds(5)
    start = time.perf_counter()
    there = surface.evaluate(face, inside)
    middle = time.perf_counter()
    surface.normals(face, inside)
    end = time.perf_counter()
    unit = 0.5 * (before + unit_seconds(5))
    size = float(np.ptp(surface.vertices[np.unique(surface.triangles)], axis=0).max())
    return Evaluated(
        case.model,
        surface.patches,
        len(surface.stored),
        (middle - start) / unit * 1e6 / points,
        (end - middle) / unit * 1e6 / points,
        float(np.linalg.norm(loaded.evaluate(face, inside) - there, axis=1).max()) / size,
        bends(surface).quantiles(SHARES),
    )


def tables(results: Sequence[Evaluated]) -> dict[str, Table]:
    """Return what was measured: sizes and speeds, and by how much the surfaces bend."""
    head = ["model", "patches", "file, MB", "points, units", "normals, units", "changed by saving"]
    rows = [
        [each.model, each.patches, each.file_bytes / 1e6, each.point_units, each.normal_units, f"{each.change:.0e}"]
        for each in results
    ]
    bent = []
    for each in results:
        for kind, angles in each.angles.items():
            if angles["surface"]:
                bent.append([each.model, kind, *(f"{angle:.2f}" for angle in (*angles["surface"], *angles["mesh"]))])
    names = ["median", "90 %", "99 %", "largest"]
    head_bent = ["model", "edges", *names, *(f"mesh, {name}" for name in names)]
    return {"representation": Table.of(head, rows), "bends": Table.of(head_bent, bent)}

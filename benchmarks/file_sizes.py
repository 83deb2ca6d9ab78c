"""Files of representations: how large each kind is, how long it takes to load, and what rounding moves."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..solver import Settings, approximate
from ..solver.surface.representation import Representation
from .cases import Case, alone, generated, unit_seconds
from .tables import Table

MODELS = ("cube", "flower", "fandisk", "bunny")
POINTS, LOADS = 200_000, 5


@dataclass(frozen=True)
class FileSizes:
    """What was measured of the files of one representation.

    Attributes
    ----------
    vertices, patches
        Of the representation.
    exact, compact, any_order
        Bytes of the exact file, of the compact one, and of the compact one that does not keep the mesh's order.
    exact_load, compact_load
        Units of loading the first two, on one core.
    moved
        Largest distance of the compact file's surface from the exact one's at random points, in longest sides.
    """

    model: str
    vertices: int
    patches: int
    exact: int
    compact: int
    any_order: int
    exact_load: float
    compact_load: float
    moved: float


def run(cases: Sequence[Case], say: Callable[[str], None]) -> tuple[dict[str, Table], Any]:
    """Measure; returns a table, and everything as plain values."""
    results: list[FileSizes] = []
    for case in cases:
        if case.model in MODELS:
            say(f"{case.model}, writing and loading files")
            results.append(alone(measure_files, case))
    return {"files": table(results)}, [asdict(each) for each in results]


def measure_files(case: Case, points: int = POINTS) -> FileSizes:
    """Approximate a model, write its representation in each way, and load it; meant to run in a process of its own."""
    vertices, faces = case.arrays if case.arrays is not None else generated(case.model, case.size)
    surface = approximate(vertices, faces, Settings(**{**case.settings, "workers": 1})).representation
    rng = np.random.default_rng(0)
    face, inside = rng.integers(0, len(surface.triangles), points), rng.dirichlet([1.0, 1.0, 1.0], points)
    with tempfile.TemporaryDirectory() as folder:
        exact, compact, any_order = (Path(folder) / f"{name}.npz" for name in ("exact", "compact", "any_order"))
        surface.save(exact)
        surface.save(compact, "compact")
        surface.save(any_order, "compact", keep_vertex_order=False)
        loaded = Representation.load(compact)
        moved = np.linalg.norm(loaded.evaluate(face, inside) - surface.evaluate(face, inside), axis=1).max()
        side = float(np.ptp(surface.vertices[np.unique(surface.triangles)], axis=0).max())
        return FileSizes(
            case.model,
            vertices=len(surface.vertices),
            patches=surface.patches,
            exact=exact.stat().st_size,
            compact=compact.stat().st_size,
            any_order=any_order.stat().st_size,
            exact_load=load_units(exact),
            compact_load=load_units(compact),
            moved=float(moved) / side,
        )


def load_units(path: Path) -> float:
    """Units of loading a file: the median of a few."""
    units = []
    for _ in range(LOADS):
        before = unit_seconds(3)
        start = time.perf_counter()
        Representation.load(path)
        seconds = time.perf_counter() - start
        units.append(seconds / (0.5 * (before + unit_seconds(3))))
    return float(np.median(units))


def table(results: Sequence[FileSizes]) -> Table:
    """Return what was measured, sizes in kB of 1,000 bytes."""
    head = ["model", "vertices", "patches", "exact, kB", "compact, kB", "compact in any order, kB"]
    head += ["loading exact, units", "loading compact, units", "moved by rounding"]
    rows = [
        [
            each.model,
            each.vertices,
            each.patches,
            *(f"{size / 1e3:,.1f}" for size in (each.exact, each.compact, each.any_order)),
            each.exact_load,
            each.compact_load,
            f"{each.moved:.1e}",
        ]
        for each in results
    ]
    return Table.of(head, rows)

"""How long it takes and how much memory: `docs/performance.md`."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from ..solver.processes.pool import WorkerExecutor
from .cases import STAGES, Case, Measured, measure
from .natural_alternative import Comparison, compare
from .tables import table

SIZES = (1_500, 5_000, 20_000, 100_000, 1_000_000)
SHOWN_STAGES = tuple(stage for stage in STAGES if stage != "refine")


def growth_exponent(runs: Sequence[Measured]) -> float:
    """Exponent e of total time ~ vertices^e, fitted by least squares to the logarithms."""
    vertices = [run.report["input"]["vertices"] for run in runs]
    slope, _ = np.polyfit(np.log(vertices), np.log([run.units("total") for run in runs]), 1)
    return float(slope)


def run(
    cases: Sequence[Case],
    sizes: Sequence[int],
    say: Callable[[str], None],
    write_back: Callable[[Case, int], float] | None,
) -> tuple[str, dict[str, Any]]:
    """Measure; returns the document and everything as plain values.

    Parameters
    ----------
    cases
        Models to time with one and with two workers.
    sizes
        Vertices of the generated terrain.
    say
        Told what begins.
    write_back
        Seconds that making the Blender mesh of a model takes, of a few tries; None without Blender.
    """
    runs: list[Measured] = []
    for case in cases:
        for workers in (1, 2):
            say(f"{case.model}, {workers} worker{'s' * (workers > 1)}")
            runs.append(measure(Case(case.model, {**case.settings, "workers": workers}, case.arrays, case.size)))
    comparisons: list[Comparison] = []
    for case in cases:
        say(f"{case.model}, the same patches by libraries")
        with WorkerExecutor(1) as process:
            comparisons.append(process.submit(compare, case).result())
    grown: list[Measured] = []
    for size in sizes:
        say(f"terrain of {size:,} vertices")
        # Two workers where one would take too long; the exponent is fitted to processor time units either way.
        grown.append(measure(Case("creased_terrain", {"workers": 1 if size < 500_000 else 2}, None, size)))
    back = {case.model: write_back(case, 5) / runs[0].unit for case in cases} if write_back is not None else {}
    values = {
        "runs": [each.as_dict() for each in runs],
        "sizes": [each.as_dict() for each in grown],
        "growth_exponent": growth_exponent(grown) if len(grown) > 1 else None,
        "natural_alternative": [asdict(each) for each in comparisons],
        "write_back_units": back,
    }
    return document(runs, grown, comparisons, back), values


def document(
    runs: Sequence[Measured], grown: Sequence[Measured], comparisons: Sequence[Comparison], back: dict[str, float]
) -> str:
    """The text of `docs/performance.md`."""
    head = ["model", "vertices", "patches", "workers", "set-up", *SHOWN_STAGES, "peak memory, MB"]
    text = f"""# Performance

Written by `make bench`.  Times are in units: one unit is one product of two 1000 x 1000 float64 matrices on one core,
measured in the same process before and after ({1e3 * np.mean([r.unit for r in runs]):.0f} ms here).  Default settings,
one sweep included, each run in a process of its own; memory is what a run takes beyond the idle interpreter with the
mesh, summed over all its processes.  Set-up, until that process has loaded the solver, is not in the total.{_load()}

## Stages

{table(head, [_row(each) for each in runs])}
"""
    if back:
        rows = list(back.items())
        text += f"Write-back, making the Blender mesh with its attributes:\n\n{table(['model', 'units'], rows)}\n"
    if grown:
        text += f"## Size\n\nA generated terrain with creases and detail.\n\n{table(head, [_row(r) for r in grown])}\n"
        one = [r for r in grown if r.report["workers"] == 1]
        if len(one) > 1:
            text += f"With one worker the total grows like vertices^{growth_exponent(one):.2f}.\n\n"
        if len(grown) > len(one) > 1:
            text += f"Over all sizes, the largest with two workers: vertices^{growth_exponent(grown):.2f}.\n\n"
    return text + _against_libraries(comparisons)


def _load() -> str:
    """What else the machine had to do: beside other work the second worker gains nothing."""
    if not hasattr(os, "getloadavg"):
        return ""
    return f"  Processes that wanted a core, of {os.cpu_count()}, at the end: {os.getloadavg()[2]:.0f}."


def _against_libraries(comparisons: Sequence[Comparison]) -> str:
    head = [
        "model",
        "patches",
        "units each",
        "vertex rms",
        "inside rms",
        "units each",
        "vertex rms",
        "inside rms",
        "times faster",
    ]
    rows = [
        (
            c.model,
            c.patches,
            c.alternative_units,
            c.alternative_vertex_rms,
            c.alternative_inside_rms,
            c.units,
            c.vertex_rms,
            c.inside_rms,
            c.alternative_units / c.units,
        )
        for c in comparisons
    ]
    return f"""## The natural alternative

The same patches, functions and regularisation, alternating scikit-learn's `orthogonal_mp` and SciPy's `L-BFGS-B` a
patch at a time (`benchmarks/natural_alternative.py`, the first three figures), against the default solver.  Errors are
relative to the model's longest side, before blending, with uniform weights.

{table(head, rows)}"""


def _row(run: Measured) -> list[object]:
    report = run.report
    return [
        run.model,
        report["input"]["vertices"],
        report["patches"],
        report["workers"],
        run.set_up / run.unit,
        *(run.units(stage) for stage in SHOWN_STAGES),
        run.memory_mb,
    ]

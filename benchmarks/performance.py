"""How long it takes and how much memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

from .cases import STAGES, Case, Measured, alone, measure
from .natural_alternative import compare
from .tables import Table

SIZES = (1_500, 5_000, 20_000, 100_000, 1_000_000)
SHOWN = tuple(stage for stage in STAGES if stage != "refine")
HEAD = ("model", "vertices", "patches", "workers", "set-up", *SHOWN, "seconds", "peak memory, MB")


def stages(cases: Sequence[Case], say: Callable[[str], None]) -> tuple[dict[str, Table], Any]:
    """Time each model with one worker and with two; returns a table, and everything as plain values."""
    runs = []
    for case in cases:
        for workers in (1, 2):
            say(f"{case.model}, {workers} worker{'s' * (workers > 1)}")
            runs.append(measure(Case(case.model, {**case.settings, "workers": workers}, case.arrays, case.size)))
    return {"stages": Table.of(HEAD, map(_row, runs))}, [each.as_dict() for each in runs]


def sizes(counts: Sequence[int], say: Callable[[str], None]) -> tuple[dict[str, Table], Any]:
    """Time terrains of these numbers of vertices; returns a table, and everything as plain values."""
    grown = []
    for size in counts:
        say(f"terrain of {size:,} vertices")
        # One worker takes too long for the largest.
        grown.append(measure(Case("creased_terrain", {"workers": 1 if size < 500_000 else 2}, None, size)))
    return {"sizes": Table.of(HEAD, map(_row, grown))}, [each.as_dict() for each in grown]


def libraries(cases: Sequence[Case], say: Callable[[str], None]) -> tuple[dict[str, Table], Any]:
    """Fit patches by libraries and by the solver; returns a table, and everything as plain values."""
    found = []
    for case in cases:
        say(f"{case.model}, the same patches by libraries")
        found.append(alone(compare, case))
    measures = ("units each", "vertex rms", "inside rms")
    head = ["model", "patches", *(f"libraries, {name}" for name in measures), *measures, "times faster"]
    rows = [
        (
            *(c.model, c.patches),
            *(c.alternative_units, c.alternative_vertex_rms, c.alternative_inside_rms),
            *(c.units, c.vertex_rms, c.inside_rms, c.alternative_units / c.units),
        )
        for c in found
    ]
    return {"libraries": Table.of(head, rows)}, [asdict(each) for each in found]


def _row(run: Measured) -> list[object]:
    report, size = run.report, run.report["input"]["vertices"]
    units = [run.set_up / run.unit, *(run.units(stage) for stage in SHOWN)]
    return [run.model, size, report["patches"], report["workers"], *units, run.seconds("total"), run.memory_mb]

"""How close the surfaces come, and what each ingredient gives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ..solver.settings import PRESETS
from .cases import Case, Measured, measure
from .tables import Table

VARIABLE_PROJECTION = "fitting.methods.variable_projection"

INGREDIENTS: tuple[tuple[str, dict[str, Any], dict[str, Any]], ...] = (
    ("the default", {}, {}),
    ("no sweep", {"sweeps": 0}, {}),
    ("two sweeps", {"sweeps": 2}, {}),
    ("sweeps without the anti-drift term", {"sweeps": 2}, {"approximation.sweeps.ANTI_DRIFT": 0.0}),
    ("domains fixed", {"iterations": 0}, {}),
    ("6 iterations", {"iterations": 6}, {}),
    ("30 iterations", {"iterations": 30}, {}),
    (
        "regularisation not annealed",
        {},
        {
            VARIABLE_PROJECTION + ".PROXIMITY_DECAY": 1.0,
            VARIABLE_PROJECTION + ".RIGIDITY_DECAY": 1.0,
        },
    ),
    ("functions selected once", {}, {VARIABLE_PROJECTION + ".RESELECT_AT": (0,)}),
    ("matching pursuit", {"pursuit": "omp"}, {}),
    ("monomials", {"basis": "monomial"}, {}),
    ("vertices observed alone", {"observations": "vertices"}, {}),
    ("patches fitted with uniform weights", {}, {"patches.blending.PLATEAU": 1e6}),
    ("uniform blending", {"blending": "uniform"}, {}),
    ("rings not adapted", {"adaptive": False}, {}),
    ("automatic sparsity", {"automatic_sparsity": True}, {}),
    ("a domain for each coordinate", {"domains": "separate"}, {}),
    ("the paper's method", {"method": "paper", "sweeps": 2}, {}),
    ("the traditional sparse fit", {"method": "traditional"}, {}),
)
"""What is changed: a name, settings, and constants of the solver."""

ERRORS = ("vertex_rms", "vertex_max", "surface_rms", "surface_max")
HEAD = ["vertex rms", "vertex max", "surface rms", "surface max", "normals, degrees", "flips", "seam", "units"]


MEASURED_PRESETS = ("default", "precise")


def presets(cases: Sequence[Case], say: Callable[[str], None]) -> tuple[dict[str, Table], Any]:
    """Measure two presets; returns a table each, and everything as plain values."""
    runs: dict[str, list[Measured]] = {}
    for name in MEASURED_PRESETS:
        for case in cases:
            say(f"{case.model}, {name}")
            runs.setdefault(name, []).append(_measure(case, PRESETS[name], {}))
    tables = {name: Table.of(["model", *HEAD], [[m.model, *_figures(m)] for m in runs[name]]) for name in runs}
    return tables, {name: [each.as_dict() for each in found] for name, found in runs.items()}


def ablation(cases: Sequence[Case], say: Callable[[str], None]) -> tuple[dict[str, Table], Any]:
    """Measure the default with one thing changed; returns a table for each model, and everything as plain values."""
    tables, values = {}, {}
    for case in cases:
        runs = {}
        for name, settings, constants in INGREDIENTS:
            say(f"{case.model}, {name}")
            runs[name] = _measure(case, settings, constants)
        tables[f"ablation, {case.model}"] = Table.of(
            ["changed", *HEAD], [[name, *_figures(run)] for name, run in runs.items()]
        )
        values[case.model] = {name: run.as_dict() for name, run in runs.items()}
    return tables, values


def _measure(case: Case, settings: dict[str, Any], constants: dict[str, Any]) -> Measured:
    changed = {**case.settings, **settings, "workers": 1}
    return measure(Case(case.model, changed, case.arrays, case.size, constants))


def _figures(run: Measured) -> list[object]:
    report, size = run.report, run.report["input"]["bounding_box_longest_side"]
    errors = [f"{report['relative'][name]:.2e}" for name in ERRORS]
    normals, seam = report["normal_error_degrees"], report["seam_max"] / size
    return [*errors, f"{normals:.1f}", report["flipped_triangles"], f"{seam:.0e}", run.units("total")]

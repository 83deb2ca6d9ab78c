"""How close the surfaces come, and what each ingredient gives: `docs/accuracy.md`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from .cases import Case, Measured, measure
from .tables import table

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
    ("a domain for each coordinate", {"domains": "separate"}, {}),
    ("the paper's method", {"method": "paper", "sweeps": 2}, {}),
    ("the traditional sparse fit", {"method": "traditional"}, {}),
)
"""What is changed: a name, settings, and constants of the solver."""

ERRORS = ("vertex_rms", "vertex_max", "surface_rms", "surface_max")
HEAD = ["", "vertex rms", "vertex max", "surface rms", "surface max", "normals, degrees", "flips", "seam", "units"]


def run(cases: Sequence[Case], ablated: Sequence[Case], say: Callable[[str], None]) -> tuple[str, dict[str, Any]]:
    """Measure; returns the document and everything as plain values.

    Parameters
    ----------
    cases
        Models for the table.
    ablated
        Models for the ablation.
    say
        Told what begins.
    """
    presets: dict[str, dict[str, Any]] = {"default": {}, "precise": {"domains": "separate"}}
    tables: dict[str, list[Measured]] = {}
    for name, settings in presets.items():
        for case in cases:
            say(f"{case.model}, {name}")
            tables.setdefault(name, []).append(_measure(case, settings, {}))
    ablation: dict[str, list[tuple[str, Measured]]] = {}
    for case in ablated:
        for name, settings, constants in INGREDIENTS:
            say(f"{case.model}, {name}")
            ablation.setdefault(case.model, []).append((name, _measure(case, settings, constants)))
    values = {
        "models": {name: [each.as_dict() for each in runs] for name, runs in tables.items()},
        "ablation": {model: {name: run.as_dict() for name, run in runs} for model, runs in ablation.items()},
    }
    return document(tables, ablation), values


def _measure(case: Case, settings: dict[str, Any], constants: dict[str, Any]) -> Measured:
    changed = {**case.settings, **settings, "workers": 1}
    return measure(Case(case.model, changed, case.arrays, case.size, constants))


def document(tables: dict[str, list[Measured]], ablation: dict[str, list[tuple[str, Measured]]]) -> str:
    """The text of `docs/accuracy.md`."""
    text = """# Accuracy

Written by `make bench`.  Errors are divided by the longest side of the bounding box.  *Vertex error* is the distance of
the surface from the input's vertices; *surface error* is measured at six points inside every triangle, where nothing
was fitted, and is the one that counts.  15 of 120 functions a coordinate; units as in [performance](performance.md).

"""
    for name, runs in tables.items():
        rows = [[each.model, *_figures(each)] for each in runs]
        text += f"## Preset `{name}`\n\n{table(['model', *HEAD[1:]], rows)}\n"
    if ablation:
        text += "## What each ingredient gives\n\nThe default with one thing changed.\n\n"
    for model, named in ablation.items():
        text += f"### {model}\n\n{table(['changed', *HEAD[1:]], [[name, *_figures(each)] for name, each in named])}\n"
    return text


def _figures(run: Measured) -> list[object]:
    report, size = run.report, run.report["input"]["bounding_box_longest_side"]
    errors = [f"{report['relative'][name]:.2e}" for name in ERRORS]
    normals, seam = report["normal_error_degrees"], report["seam_max"] / size
    return [*errors, f"{normals:.1f}", report["flipped_triangles"], f"{seam:.0e}", f"{run.units('total'):.0f}"]

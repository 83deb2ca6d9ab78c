"""docs/paper.md: the template's prose with the numbers of the notebook."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from .measurements import Notebook
from .models import CHECKOUT, PAPER_MODELS, PaperModel

TEMPLATE = Path(__file__).with_name("paper.template.md")
PAGE = CHECKOUT / "docs" / "paper.md"

Sections = dict[str, dict[str, Any]]

METHODS = {
    "traditional": "traditional",
    "printed": "paper, as printed",
    "settling": "paper, settling",
    "freer": "paper, freer",
    "default": "default",
    "creased": "with creases",
}


def write_page(notebook: Notebook) -> Path:
    """Write docs/paper.md, beside its place and then into it."""
    partial = PAGE.with_name(f".{PAGE.name}.partial")
    partial.write_text(page(notebook.content), encoding="utf-8")
    partial.replace(PAGE)
    return PAGE


def page(measured: Sections) -> str:
    """Return the page; a section whose figure has not been made says so."""
    values = Values(measured)
    parts = re.split(r"(?m)^(?=## )", TEMPLATE.read_text(encoding="utf-8"))
    return "".join(filled(part, values) for part in parts).rstrip("\n") + "\n"


OPTIONAL = "? "
"""Begins a paragraph of the template that is dropped where its numbers are missing; without it, its section is."""


def filled(part: str, values: Values) -> str:
    """Return a section with its numbers."""
    paragraphs = []
    for paragraph in part.split("\n\n"):
        try:
            paragraphs.append(paragraph.removeprefix(OPTIONAL).format_map(values))
        except Missing as missing:
            if not paragraph.startswith(OPTIONAL):
                heading = part.partition("\n")[0]
                return f"{heading}\n\nNot measured yet: `make figures` does it ({missing}).\n\n"
    return "\n\n".join(paragraphs).rstrip("\n") + "\n\n"


class Missing(Exception):
    """A number that the notebook does not have."""


class Entries(dict[str, Any]):
    """Entries of a section that complain in the page's words."""

    def __missing__(self, key: str) -> Any:
        raise Missing(f"no {key}")


class Values(dict[str, Any]):
    """What the template may name: sections as `figure_1[key]`, and everything that `DERIVED` makes of them."""

    def __init__(self, measured: Sections) -> None:
        super().__init__()
        self.measured = measured

    def __missing__(self, name: str) -> Any:
        if name in DERIVED:
            return DERIVED[name](self)
        if not name.startswith("figure_"):
            raise KeyError(name)
        return self.section(name.replace("_", " "))

    def section(self, name: str) -> Entries:
        return Entries(self.measured.get(name, {}))

    def run(self, model: str, method: str) -> dict[str, Any]:
        entry: dict[str, Any] = self.section("models")[f"{model} {method}"]
        return entry

    def run_if_made(self, model: PaperModel, method: str) -> dict[str, Any] | None:
        """Return what a run gave; None where the method was not run on the model."""
        return self.section("models").get(f"{model.key} {method}") if method in model.methods else None

    def runs(self) -> list[PaperModel]:
        """Return the models that were measured; runs with creases came later than the others and may be missing."""
        have = self.section("models").keys()
        needed = {
            model: {f"{model.key} {method}" for method in model.methods if method != "creased"}
            for model in PAPER_MODELS
        }
        found = [model for model, names in needed.items() if names <= have]
        if not found:
            raise Missing("no models")
        return found


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table; all columns but the first are numbers."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


# ---------------------------------------------------------------------------------------------------- single figures


def crease_gain(values: Values) -> float:
    rms = values.section("figure 1")
    return float(rms["crease, fixed domain"] / rms["crease, optimised domain"])


def figure_4_table(values: Values) -> str:
    entries = values.section("figure 4")
    methods = list(dict.fromkeys(key.partition(" ")[2] for key in entries))
    if not methods:
        raise Missing("no figure 4")
    methods.sort(key=lambda name: -entries[f"crease {name}"]["rms"])
    head = ["one patch", "smooth: rms", "flips", "units", "crease: rms", "flips", "units"]
    rows = []
    for name in methods:
        cells = [entries[f"{kind} {name}"] for kind in ("smooth", "crease")]
        texts = ((f"{e['rms']:.1e}", str(e["flips"]), f"{e['units']:.2g}") for e in cells)
        rows.append([name, *(text for three in texts for text in three)])
    return table(head, rows)


def printed_over_traditional(values: Values) -> float:
    entries = values.section("figure 4")
    return float(entries["smooth paper as printed"]["units"] / entries["smooth traditional"]["units"])


def misfit(values: Values, name: str) -> list[float]:
    found: list[float] = values.section("figure 5")[f"crease {name}"]
    return found


def settling_table(values: Values) -> str:
    head = ["model", *(METHODS[method] for method in ("printed", "settling", "freer")), "lowest at (as printed)"]
    rows = []
    for model in values.runs():
        row = [model.name]
        for method in ("printed", "settling", "freer"):
            row.append(f"{last_over_lowest(values, model, method):.2f}" if method in model.methods else "")
        energy = values.run(model.key, "printed")["energy"]
        rows.append([*row, f"iteration {energy.index(min(energy)) + 1}"])
    return table(head, rows)


def last_over_lowest(values: Values, model: PaperModel, method: str) -> float:
    energy = values.run(model.key, method)["energy"]
    return float(energy[-1] / min(energy))


DOMAINS = {"lscm": "LSCM", "harmonic": "circle, discrete conformal", "tutte": "circle, Tutte"}


def figure_6_table(values: Values) -> str:
    entries = values.section("figure 6")
    head = ["initial domain", "paper, freer: surface rms", "at vertices", "default: surface rms", "at vertices"]
    rows = []
    for kind, name in DOMAINS.items():
        cells = [entries[f"{method} {kind}"] for method in ("paper", "default")]
        rows.append([name, *(f"{e[key]:.2e}" for e in cells for key in ("surface_rms", "vertex_rms"))])
    return table(head, rows)


def domain_spread(values: Values, method: str) -> float:
    found = [values.section("figure 6")[f"{method} {kind}"]["surface_rms"] for kind in DOMAINS]
    return float(max(found) / min(found) - 1.0)


def figure_7_table(values: Values) -> str:
    entries = values.section("figure 7")
    if not entries:
        raise Missing("no figure 7")
    ordered = sorted(entries.items(), key=lambda item: (-item[1]["flips"], item[1]["rms"]))
    return table(["regularisation", "flips", "rms"], [[k, str(e["flips"]), f"{e['rms']:.1e}"] for k, e in ordered])


def figure_9_table(values: Values) -> str:
    entries = values.section("figure 9")
    head = ["", "sweeps", "gaps, rms", "gaps, largest", "rms at vertices", "surface rms", "seam"]
    rows = []
    for name in ("paper as printed", "default"):
        for sweeps in (0, 1, 2):
            entry = entries[f"{name} {sweeps}"]
            keys = ("gap_rms", "gap_max", "vertex_rms", "surface_rms", "seam")
            rows.append([name, str(sweeps), *(f"{entry[key]:.1e}" for key in keys)])
    return table(head, rows)


def sweeps_gain(values: Values) -> float:
    entries = values.section("figure 9")
    return 1.0 - float(entries["paper as printed 2"]["surface_rms"] / entries["paper as printed 0"]["surface_rms"])


RINGS = (5, 7, 10)


def figure_10_table(values: Values) -> str:
    entries = values.section("figure 10")
    columns = ("patches", "rms at vertices", "surface rms")
    head = ["Cube", *(f"k = {ring}: {column}" for ring in RINGS for column in columns)]
    rows = []
    for name in ("paper as printed", "default", "with creases"):
        cells = [entries[f"{name} {ring}"] for ring in RINGS]
        texts = ([str(e["patches"]), f"{e['vertex_rms']:.1e}", f"{e['surface_rms']:.1e}"] for e in cells)
        rows.append([name, *(text for three in texts for text in three)])
    return table(head, rows)


def best_ring(values: Values, name: str) -> int:
    entries = values.section("figure 10")
    return min(RINGS, key=lambda ring: entries[f"{name} {ring}"]["surface_rms"])


# ------------------------------------------------------------------------------------------------------- whole models


def left_out(values: Values) -> str:
    names = [name for found in values.section("left out").values() for name in found]
    return f"**Left out**, since the files are not in ../shared/models: {', '.join(names)}. " if names else ""


def errors_table(values: Values) -> str:
    rows = []
    for model in values.runs():
        runs = [values.run_if_made(model, method) for method in METHODS]
        rows.append([model.name, *(f"{r['surface_rms']:.1e} / {r['surface_max']:.1e}" if r else "" for r in runs)])
    return table(["model", *METHODS.values()], rows)


def ratio(values: Values, model: PaperModel, worse: str, better: str) -> float | None:
    """Return how many times the surface rms of one method is that of another; None where one was not run."""
    one, other = (values.run_if_made(model, method) for method in (worse, better))
    return None if one is None or other is None else float(one["surface_rms"] / other["surface_rms"])


PAIRS = (
    ("traditional", "printed"),
    ("printed", "settling"),
    ("printed", "freer"),
    ("freer", "default"),
    ("printed", "default"),
    ("default", "creased"),
)


FLIPS = ("printed", "freer", "default")

EXACT = 1000.0
"""From this ratio on the better of two surfaces is the input itself, to rounding."""


def times(ratio: float) -> str:
    """A ratio with two places, or its power of ten where one of the two is exact."""
    return f"{ratio:.2f}" if ratio < EXACT else f"{ratio:.0e}"


def ratios_table(values: Values) -> str:
    head = [
        "model",
        *(f"{one} / {other}".replace("creased", "with creases") for one, other in PAIRS),
        "flips: printed",
        *FLIPS[1:],
    ]
    rows = []
    for model in values.runs():
        found = (ratio(values, model, *pair) for pair in PAIRS)
        runs = [values.run_if_made(model, method) for method in FLIPS]
        flips = ("" if run is None else str(run["flips"]) for run in runs)
        rows.append([model.name, *("" if r is None else times(r) for r in found), *flips])
    return table(head, rows)


def largest_error(values: Values, method: str) -> float:
    runs = (values.run_if_made(model, method) for model in values.runs())
    return max((float(run["vertex_max"]) for run in runs if run is not None), default=float("nan"))


def table_1(values: Values) -> str:
    head = [
        "model", "vertices: paper", "ours", "patches: paper", "ours", "difference", "paper, minutes",
        "traditional, units", "as printed, units", "default, units", "with creases, units",
        "as printed, s", "default, s", "with creases, s",
    ]  # fmt: skip
    rows = []
    for model in values.runs():
        runs = {method: values.run(model.key, method) for method in ("traditional", "printed", "default")}
        creased = values.run_if_made(model, "creased")
        patches = runs["printed"]["patches"]
        rows.append(
            [
                model.name,
                f"{model.vertices:,}",
                f"{runs['printed']['vertices']:,}",
                str(model.patches),
                str(patches),
                f"{patches / model.patches - 1.0:+.0%}",
                f"{model.minutes:g}",
                *(f"{run['units']:.0f}" for run in runs.values()),
                "" if creased is None else f"{creased['units']:.0f}",
                *(f"{runs[method]['seconds']:.3g}" for method in ("printed", "default")),
                "" if creased is None else f"{creased['seconds']:.3g}",
            ]
        )
    return table(head, rows)


def against_cube(values: Values, method: str, *, each_vertex: bool = False) -> float:
    """Return the Bunny's time over the Cube's, whole or for each vertex."""
    bunny, cube = (values.run(model, method) for model in ("bunny", "cube"))
    vertices = bunny["vertices"] / cube["vertices"] if each_vertex else 1.0
    return float(bunny["units"] / cube["units"] / vertices)


def paper_bunny(_: Values) -> float:
    minutes = {model.key: model.minutes for model in PAPER_MODELS}
    return minutes["bunny"] / minutes["cube"]


# ------------------------------------------------------------------------------------------------------------ targets


def targets(values: Values) -> str:
    """Return the table of what was asked for and what came out."""
    models = {model.key: model for model in values.runs()}
    creased = [model for model in models.values() if model.creased]
    rows = []

    def add(asked: str, found: str, met: bool) -> None:
        rows.append([asked, found, "yes" if met else "**no**"])

    counts = {m: values.run(m.key, "printed")["patches"] / m.patches - 1.0 for m in models.values()}
    others = {m.name: abs(c) for m, c in counts.items() if m.key != "cube"}
    if others:
        far = max(others, key=lambda name: others[name])
        add("patches within 15 % of Table 1", f"{others[far]:.0%} at most ({far})", others[far] <= 0.15)
    if "cube" in models:
        add(
            "patches on Cube within 25 % of Table 1",
            f"{abs(counts[models['cube']]):.0%}",
            abs(counts[models["cube"]]) <= 0.25,
        )
    for worse, better, least, how in (
        ("traditional", "printed", 1.0, "no worse"),
        ("printed", "freer", 1.5, "1.5 times better"),
    ):
        found = {m.name: ratio(values, m, worse, better) or 0.0 for m in creased}
        if found:
            low = min(found, key=lambda name: found[name])
            text = f"{METHODS[better]}: {how} than {METHODS[worse]} on every creased model"
            add(text, f"{found[low]:.2f} times better at least ({low})", found[low] >= least)
    for key, least in (("cube", 3.3), ("fandisk", 3.3), ("bunny", 3.5)):
        if key in models:
            gain = ratio(values, models[key], "printed", "default") or 0.0
            same = values.run(key, "printed")["patches"] == values.run(key, "default")["patches"]
            text = f"{models[key].name}: default {least:g} times better than {METHODS['printed']}, same cover"
            add(text, f"{gain:.2f} times", gain >= least and same)
    return table(["aim (surface rms)", "measured", "met"], rows)


DERIVED: dict[str, Callable[[Values], Any]] = {
    "targets": targets,
    "crease_gain": crease_gain,
    "figure_4_table": figure_4_table,
    "printed_over_traditional": printed_over_traditional,
    "printed_best": lambda v: misfit(v, "paper as printed").index(min(misfit(v, "paper as printed"))) + 1,
    "printed_last": lambda v: misfit(v, "paper as printed")[-1] / min(misfit(v, "paper as printed")),
    "settling_last": lambda v: misfit(v, "paper, rho 1, f = b")[-1] / min(misfit(v, "paper, rho 1, f = b")),
    "settling_table": settling_table,
    "figure_6_table": figure_6_table,
    "domains_paper": lambda v: domain_spread(v, "paper"),
    "domains_default": lambda v: domain_spread(v, "default"),
    "figure_7_table": figure_7_table,
    "figure_9_table": figure_9_table,
    "sweeps_gain": sweeps_gain,
    "figure_10_table": figure_10_table,
    "best_ring_printed": lambda v: best_ring(v, "paper as printed"),
    "best_ring_default": lambda v: best_ring(v, "default"),
    "left_out": left_out,
    "errors_table": errors_table,
    "ratios_table": ratios_table,
    "default_flips": lambda v: sum(v.run(model.key, "default")["flips"] for model in v.runs()),
    "largest_printed": lambda v: largest_error(v, "printed"),
    "largest_freer": lambda v: largest_error(v, "freer"),
    "largest_creased": lambda v: largest_error(v, "creased"),
    "largest_default": lambda v: largest_error(v, "default"),
    "table_1": table_1,
    "paper_bunny": paper_bunny,
    "printed_bunny": lambda v: against_cube(v, "printed"),
    "default_bunny": lambda v: against_cube(v, "default"),
    "printed_vertex": lambda v: against_cube(v, "printed", each_vertex=True),
    "default_vertex": lambda v: against_cube(v, "default", each_vertex=True),
}
"""Name in the template -> what makes it of the notebook."""

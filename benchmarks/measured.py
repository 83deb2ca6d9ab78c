"""One source for each measured figure: `docs/measured.json`.

`make bench` writes it: tables, and figures that are computed from them.  Pages take theirs from it, between marks:

    <!--measured:precise, accuracy-->1.2 to 3.2<!--/measured-->     a figure
    <!--measured:default / bunny / units-->238<!--/measured-->       a cell: table / row / column
    <!--measured:stages-->                                           a table, on lines of its own
    <!--measured:stages | model | solve | total-->                   some columns of one

A row is named by its first cell or by some of its cells, "bunny, 2", that no other row has.  A mark that is not a table
must not begin a line: Markdown would take the line for HTML.  `make pages` fills the marks, a test compares them.
"""

from __future__ import annotations

import contextlib
import datetime
import json
import os
import platform
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .tables import Table

Tables = Mapping[str, Table]

CHECKOUT = Path(__file__).resolve().parent.parent
FILE = CHECKOUT / "docs" / "measured.json"
ROUNDING = 1e-9
"""Errors of planes, in shares of the longest side, are smaller."""
LARGE = 50_000
"""Vertices of a mesh whose memory is not lost in that of the loaded libraries."""
MARK = re.compile(r"(<!--measured:(?P<key>[^>]+?)-->)(?P<text>.*?)(<!--/measured-->)", re.DOTALL)


@dataclass(frozen=True)
class Figure:
    """A figure that follows from tables.

    Attributes
    ----------
    unit
        What the number counts.
    tables
        Names of the tables.
    values
        Computes it: a number for each model, or a single one.
    digits
        Behind the point.
    """

    unit: str
    tables: tuple[str, ...]
    values: Callable[[Tables], Mapping[str, float]]
    digits: int = 1

    def text(self, tables: Tables) -> str:
        """Return the figure as pages show it: a number, or the smallest and the largest."""
        values = self.values(tables).values()
        ends = list(dict.fromkeys(f"{end:.{self.digits}f}" for end in (min(values), max(values))))
        return " to ".join(ends) + (" %" if self.unit.startswith("%") else "")


def _ratio(over: Callable[[Tables], Table], under: Callable[[Tables], Table], top: str, bottom: str) -> Any:
    def values(tables: Tables) -> dict[str, float]:
        a, b = over(tables), under(tables)
        rows = zip(a.column("model"), a.numbers(top), b.numbers(bottom), strict=True)
        return {model: one / other for model, one, other in rows}

    return values


def _changed(what: str, column: str) -> Any:
    """Return what computes, for each model of the ablation, the column's quotient of one change and the default."""

    def values(tables: Tables) -> dict[str, float]:
        each = {model: tables[f"ablation, {model}"] for model in ("cube", "fandisk")}
        return {
            model: float(table.cell(what, column)) / float(table.cell("the default", column))
            for model, table in each.items()
        }

    return values


def _growth(tables: Tables) -> dict[str, float]:
    one = tables["sizes"].only(workers="1")
    return {"creased_terrain": growth_exponent(one.numbers("vertices"), one.numbers("total"))}


def _memory(tables: Tables) -> dict[str, float]:
    sizes = tables["sizes"]
    both = zip(sizes.numbers("vertices"), sizes.numbers("peak memory, MB"), strict=True)
    return {f"{count:,.0f}": 1000.0 * megabytes / count for count, megabytes in both if count >= LARGE}


def growth_exponent(vertices: list[float], units: list[float]) -> float:
    """Return the exponent e of time ~ vertices^e, fitted by least squares to the logarithms."""
    slope, _ = np.polyfit(np.log(vertices), np.log(units), 1)
    return float(slope)


def _of(name: str, **cells: str) -> Callable[[Tables], Table]:
    return lambda tables: tables[name].only(**cells)


def _curved(name: str) -> Callable[[Tables], Table]:
    """Return what finds the rows of models with errors above rounding: without those of planes."""

    def rows(tables: Tables) -> Table:
        table = tables[name]
        kept = zip(table.rows, table.numbers("surface rms"), strict=True)
        return replace(table, rows=tuple(row for row, error in kept if error > ROUNDING))

    return rows


def _columns(name: str, column: str) -> Callable[[Tables], dict[str, float]]:
    return lambda tables: dict(zip(tables[name].column("model"), tables[name].numbers(column), strict=True))


def _rms_beside_meshlab(tables: Tables) -> dict[str, float]:
    largest: dict[str, float] = {}
    table = tables["distances"]
    rows = zip(table.column("model"), table.numbers("MeshLab: rms"), table.numbers("rms"), strict=True)
    for model, theirs, ours in rows:
        largest[model] = max(largest.get(model, 0.0), 100.0 * abs(theirs / ours - 1.0))
    return largest


def _percent(values: Callable[[Tables], Mapping[str, float]], less: float = 0.0) -> Any:
    return lambda tables: {model: 100.0 * (value - less) for model, value in values(tables).items()}


_ABLATION = ("ablation, cube", "ablation, fandisk")
_ONE, _TWO = _of("stages", workers="1"), _of("stages", workers="2")

FIGURES = {
    "precise, accuracy": Figure(
        "times smaller surface rms",
        ("default", "precise"),
        _ratio(_curved("default"), _curved("precise"), "surface rms", "surface rms"),
    ),
    "precise, time": Figure(
        "times the time", ("default", "precise"), _ratio(_of("precise"), _of("default"), "units", "units")
    ),
    "sweep, share": Figure("% of the solve", ("stages",), _percent(_ratio(_ONE, _ONE, "sweeps", "solve")), 0),
    "no sweep, error": Figure(
        "% more surface rms",
        ("ablation, cube", "ablation, fandisk"),
        _percent(_changed("no sweep", "surface rms"), 1.0),
        0,
    ),
    "automatic sparsity, time": Figure("times the time", _ABLATION, _changed("automatic sparsity", "units")),
    "second worker, speed": Figure("times as fast", ("stages",), _ratio(_ONE, _TWO, "total", "total")),
    "memory of a vertex": Figure("kB", ("sizes",), _memory),
    "growth": Figure("exponent of the number of vertices", ("sizes",), _growth, 2),
    "libraries, time": Figure("times the time", ("libraries",), _columns("libraries", "times faster")),
    "distances, rms": Figure("% from MeshLab's", ("distances",), _rms_beside_meshlab, 1),
    "million points": Figure("units", ("representation",), _columns("representation", "points, units"), 0),
    "million normals": Figure("units", ("representation",), _columns("representation", "normals, units"), 0),
}
"""What pages say in words about tables."""


def machine() -> str:
    """Return what kind of machine this is, without its name."""
    model = platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = re.findall(r"^model name\s*: (.+)$", info.read_text(encoding="utf-8"), re.MULTILINE)
        model = names[0] if names else model
    return f"{model}, {os.cpu_count()} cores, NumPy {np.__version__}"


def read(path: Path = FILE) -> dict[str, Table]:
    """Return the tables of the file."""
    found = json.loads(path.read_text(encoding="utf-8"))["tables"] if path.exists() else {}
    return {
        name: Table(tuple(each["head"]), tuple(map(tuple, each["rows"])), each["measured"], each["machine"])
        for name, each in found.items()
    }


def content(tables: Tables) -> str:
    """Return the text of the file: the tables, and the figures that follow from those that are there."""
    figures = {}
    for name, figure in FIGURES.items():
        with contextlib.suppress(KeyError):
            first = min((tables[table] for table in figure.tables), key=lambda table: table.measured)
            figures[name] = {
                "text": figure.text(tables),
                "unit": figure.unit,
                "models": list(figure.values(tables)),
                "tables": list(figure.tables),
                "measured": first.measured,
                "machine": first.machine,
            }
    text = json.dumps({"figures": figures, "tables": {name: asdict(tables[name]) for name in tables}}, indent=1)
    # A row on a line, so that differences can be read.
    return re.sub(r"\[\s+([^][{}]*?)\s+\]", lambda row: "[" + re.sub(r",\n\s+", ", ", row[1]) + "]", text) + "\n"


def add(new: Tables, path: Path = FILE) -> None:
    """Put tables that were measured now into the file, in the place of those of the same name."""
    today = datetime.date.today().isoformat()
    stamped = {name: replace(table, measured=today, machine=machine()) for name, table in new.items()}
    write(path, content({**read(path), **stamped}))


def write(path: Path, text: str) -> None:
    """Write beside and rename into place."""
    draft = path.with_name(path.name + ".part")
    draft.write_text(text, encoding="utf-8")
    draft.replace(path)


def shown(key: str, tables: Tables) -> str:
    """Return what stands between the marks of a key.

    Raises
    ------
    KeyError
        When it names nothing that was measured.
    """
    if key in FIGURES:
        return FIGURES[key].text(tables)
    name, *columns = (part.strip() for part in key.split("|"))
    name, *place = (part.strip() for part in name.split(" / "))
    if name not in tables:
        raise KeyError(f"no figure or table '{name}'")
    if not place:
        return "\n" + tables[name].markdown(columns)
    row, *column = place  # a column's name may have slashes of its own
    return tables[name].cell(row, " / ".join(column))


def filled(text: str, tables: Tables) -> str:
    """Return a page with every mark filled."""
    return MARK.sub(lambda found: found[1] + shown(found["key"], tables) + found[4], text)


def pages() -> list[Path]:
    """Return the pages that may show figures."""
    return [*sorted(CHECKOUT.glob("*.md")), *sorted((CHECKOUT / "docs").rglob("*.md"))]

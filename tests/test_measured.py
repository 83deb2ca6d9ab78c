"""Pages take their figures from one measured file, and their tables of settings from the settings."""

from __future__ import annotations

import dataclasses
import importlib
import json
import re
import sys
from pathlib import Path

import pytest
from sparse_surface.benchmarks import measured
from sparse_surface.benchmarks.tables import Table
from sparse_surface.solver import CloudSettings, Settings

SCRIPTS = measured.CHECKOUT / "scripts"


def fill_pages():
    sys.path.insert(0, str(SCRIPTS))
    try:
        return importlib.import_module("fill_pages")
    finally:
        sys.path.pop(0)


STAGES = Table(
    ("model", "workers", "solve", "sweeps"),
    (("cube", "1", "10.00", "4.00"), ("cube", "2", "6.00", "3.00"), ("bunny", "1", "1,000", "450")),
)


@pytest.mark.parametrize("path", measured.pages(), ids=lambda path: path.name)
def test_every_marked_place_shows_its_source(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert text == fill_pages().filled(text), "run `make pages`"
    assert text.count("<!--/measured-->") == len(re.findall("<!--measured:", text)) == len(measured.MARK.findall(text))
    # Markdown takes a line that begins with a comment for HTML.
    assert not re.findall(r"^\s*<!--measured:[^>]+-->[^\n]", text, re.MULTILINE)


def test_figures_follow_from_the_tables_of_the_file() -> None:
    tables = measured.read()
    assert measured.FILE.read_text(encoding="utf-8") == measured.content(tables)
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\d", table.measured) for table in tables.values())
    assert all(table.machine for table in tables.values())
    figures = json.loads(measured.FILE.read_text(encoding="utf-8"))["figures"]
    assert {name: each["text"] for name, each in figures.items()} == {
        name: figure.text(tables) for name, figure in measured.FIGURES.items()
    }


def test_figures_are_what_a_reader_computes_from_the_tables() -> None:
    assert measured.shown("sweep, share", {"stages": STAGES}) == "40 to 45 %"
    head, plane = ("model", "surface rms", "units"), ("plane", "1.00e-16", "1")
    default = Table(head, (("a", "2.00e-03", "10"), ("b", "6.00e-03", "20"), plane))
    precise = Table(head, (("a", "1.00e-03", "15"), ("b", "2.00e-03", "50"), ("plane", "1.00e-13", "2")))
    tables = {"default": default, "precise": precise}
    assert measured.shown("precise, accuracy", tables) == "2.0 to 3.0"
    assert measured.shown("precise, time", tables) == "1.5 to 2.5"
    squares = [str(n * n) for n in (10, 100, 1000)]
    sizes = Table(
        ("vertices", "workers", "total"), tuple(zip(("10", "100", "1,000"), ("1", "1", "1"), squares, strict=True))
    )
    assert measured.shown("growth", {"sizes": sizes}) == "2.00"
    memory = Table(("vertices", "peak memory, MB"), (("1,000", "40"), ("100,000", "250"), ("1,000,000", "2,300")))
    assert measured.shown("memory of a vertex", {"sizes": memory}) == "2.3 to 2.5"


def test_marks_show_figures_tables_columns_and_cells() -> None:
    tables = {"stages": STAGES}
    text = "x <!--measured:stages / cube, 2 / sweeps-->?<!--/measured-->, "
    text += "<!--measured:stages / bunny / solve--><!--/measured-->"
    assert re.sub("<.*?>", "", measured.filled(text, tables)) == "x 3.00, 1,000"
    assert measured.filled("<!--measured:stages | model | sweeps-->\nold\n<!--/measured-->", tables) == (
        "<!--measured:stages | model | sweeps-->\n| model | sweeps |\n| --- | ---: |\n"
        "| cube | 4.00 |\n| cube | 3.00 |\n| bunny | 450 |\n<!--/measured-->"
    )
    assert measured.shown("stages", tables).startswith("\n| model | workers | solve | sweeps |\n")
    with_slashes = Table(("cloud", "rms / max"), (("ball", "1 / 2"),))
    assert measured.shown("clouds / ball / rms / max", {"clouds": with_slashes}) == "1 / 2"
    for unknown in ("other", "stages / cube / solve", "stages / cat / solve", "stages / bunny / none", "stages | none"):
        with pytest.raises(KeyError):
            measured.shown(unknown, tables)


def test_measured_tables_take_the_place_of_older_ones(tmp_path: Path) -> None:
    path = tmp_path / "measured.json"
    measured.add({"stages": STAGES, "other": STAGES}, path)
    newer = dataclasses.replace(STAGES, rows=STAGES.rows[:1])
    measured.add({"stages": newer}, path)
    found = measured.read(path)
    assert found["stages"].rows == newer.rows
    assert found["other"].rows == STAGES.rows
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", found["stages"].measured)
    assert "cores" in found["stages"].machine
    assert [each.name for each in tmp_path.iterdir()] == ["measured.json"]


def test_every_setting_is_in_one_group_and_on_a_page() -> None:
    script = fill_pages()
    names = [item.name for group in ("everyday", "expert", "paper") for item in script.group_of(group)]
    assert sorted(names) == sorted(item.name for item in dataclasses.fields(Settings))
    clouds = [item.name for item in script.group_of("clouds")]
    assert clouds == [item.name for item in dataclasses.fields(CloudSettings)]
    groups = [
        block["group"] for path in measured.pages() for block in script.BLOCK.finditer(path.read_text(encoding="utf-8"))
    ]
    assert "all" in groups or {"everyday", "expert", "paper"} <= set(groups)


def test_a_table_of_settings_says_default_values_and_effect() -> None:
    row = next(line for line in fill_pages().table("everyday").splitlines() if line.startswith("| `ring` |"))
    ring = next(item for item in dataclasses.fields(Settings) if item.name == "ring")
    assert row.startswith(f"| `ring` | {ring.default} | {ring.metadata['low']} to {ring.metadata['high']} | ")
    assert ring.metadata["text"].rstrip(".") in row


def test_settings_quote_no_measured_figure() -> None:
    """What a panel's tooltip says cannot follow a measurement."""
    texts = [
        text
        for kind in (Settings, CloudSettings)
        for item in dataclasses.fields(kind)
        for text in (item.metadata["text"], *item.metadata.get("choices", {}).values())
    ]
    measures = re.compile(r"\d to \d+ times|twice the|times the time|a (half|third|quarter|fifth|tenth) of", re.I)
    assert [text for text in texts if measures.search(text)] == []

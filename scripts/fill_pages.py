"""Fill the marked places of README.md and docs/: measured figures, and tables of settings.

Measured figures stand between `<!--measured:KEY-->` and `<!--/measured-->` (see `benchmarks/measured.py` for keys),
settings between lines `<!--settings:GROUP-->` and `<!--/settings-->`: everyday, expert, paper, clouds or all.
A test compares every marked place with its source.
"""

from __future__ import annotations

import dataclasses
import re
import sys

from sparse_surface.benchmarks import measured
from sparse_surface.solver import CloudSettings, Settings
from sparse_surface.solver.patch_methods import METHODS

BLOCK = re.compile(r"(<!--settings:(?P<group>\w+)-->\n)(?P<table>.*?)(<!--/settings-->)", re.DOTALL)

EVERYDAY = (
    *("method", "domains", "ring", "sparsity", "sweeps", "tolerance", "denoise", "denoise_strength", "noise_level"),
    *("creases", "mark_creases", "merge_vertices", "merge_distance", "pin_boundary", "workers"),
)
PAPER = METHODS["paper"].own_settings
"""Settings of the paper's own iteration."""


def group_of(name: str) -> list[dataclasses.Field[object]]:
    """Return the settings of a group."""
    if name == "clouds":
        return list(dataclasses.fields(CloudSettings))
    items = {item.name: item for item in dataclasses.fields(Settings)}
    expert = [name for name in items if name not in (*EVERYDAY, *PAPER)]
    return [items[each] for each in {"everyday": EVERYDAY, "expert": expert, "paper": PAPER, "all": items}[name]]


def default_of(item: dataclasses.Field[object]) -> str:
    value = item.default
    return {True: "on", False: "off"}[value] if isinstance(value, bool) else f"{value}"


def choice_of(item: dataclasses.Field[object]) -> str:
    """Return what the setting may be: its choices, on or off, or its range."""
    if "choices" in item.metadata:
        return ", ".join(f"`{name}`" for name in item.metadata["choices"])
    if isinstance(item.default, bool):
        return "on, off"
    return f"{item.metadata['low']:g} to {item.metadata['high']:g}"


def effect_of(item: dataclasses.Field[object]) -> str:
    """Return the setting's text, with those of its choices."""
    choices = item.metadata.get("choices", {})
    sentences = [item.metadata["text"], *(f"`{name}`: {text}" for name, text in choices.items())]
    return ". ".join(sentence.rstrip(".") for sentence in sentences).replace("|", "\\|") + "."


def table(group: str) -> str:
    """Return the table of a group as Markdown, ending in a line break."""
    lines = ["| setting | default | values | effect and cost |", "| --- | --- | --- | --- |"]
    for item in group_of(group):
        cells = (f"`{item.name}`", default_of(item), choice_of(item), effect_of(item))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def filled(text: str) -> str:
    """Return a page with every marked place filled."""
    text = BLOCK.sub(lambda block: block[1] + table(block["group"]) + block[4], text)
    return measured.filled(text, measured.read())


def main() -> int:
    for path in measured.pages():
        text = path.read_text(encoding="utf-8")
        if filled(text) != text:
            measured.write(path, filled(text))
            print(path.relative_to(measured.CHECKOUT))
    return 0


if __name__ == "__main__":
    sys.exit(main())

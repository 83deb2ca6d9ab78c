"""Fill the tables of docs/settings.md from the solver's own list of settings (a test compares them)."""

from __future__ import annotations

import dataclasses
import re
import sys
from pathlib import Path

from sparse_surface.solver import CloudSettings, Settings

PAGE = Path(__file__).resolve().parent.parent / "docs" / "settings.md"
BLOCK = re.compile(r"(?<=<!--settings:)(\w+)-->\n.*?(?=<!--/settings-->)", re.DOTALL)
EVERYDAY = (
    "method", "ring", "sparsity", "tolerance", "domains", "denoise", "denoise_strength", "noise_level", "pin_boundary",
    "mark_creases", "workers",
)  # fmt: skip
PAPER = ("rho", "tau", "initial_fit", "regularisation", "rigidity_reference")


def groups() -> dict[str, list[dataclasses.Field[object]]]:
    """Return the settings of each group, in the order of the fields; what belongs to no other is for experts."""
    found: dict[str, list[dataclasses.Field[object]]] = {"everyday": [], "expert": [], "paper": []}
    for item in dataclasses.fields(Settings):
        found["everyday" if item.name in EVERYDAY else "paper" if item.name in PAPER else "expert"].append(item)
    return {**found, "clouds": list(dataclasses.fields(CloudSettings))}


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
    for item in groups()[group]:
        cells = (f"`{item.name}`", default_of(item), choice_of(item), effect_of(item))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def filled(text: str) -> str:
    """Return the page's text with its tables as they should be."""
    return BLOCK.sub(lambda found: f"{found[1]}-->\n{table(found[1])}", text)


def main() -> int:
    text = PAGE.read_text(encoding="utf-8")
    if {found[1] for found in BLOCK.finditer(text)} != groups().keys():
        print(f"{PAGE.name} must have one place for each of: {', '.join(groups())}.", file=sys.stderr)
        return 1
    PAGE.write_text(filled(text), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

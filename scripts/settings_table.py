"""Write the table of settings in README.md anew from the solver's own list (a test compares them)."""

from __future__ import annotations

import dataclasses
import re
import sys
from pathlib import Path

from sparse_surface.solver.settings import Settings

README = Path(__file__).resolve().parent.parent / "README.md"
BLOCK = re.compile(r"(?<=<!-- settings -->\n).*?(?=<!-- end of settings -->)", re.DOTALL)


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


def table() -> str:
    """Return the table as Markdown, ending in a line break."""
    lines = ["| setting | default | values | effect and cost |", "| --- | --- | --- | --- |"]
    for item in dataclasses.fields(Settings):
        cells = (f"`{item.name}`", default_of(item), choice_of(item), effect_of(item))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    text = README.read_text(encoding="utf-8")
    if not BLOCK.search(text):
        print("README.md has no place for the settings.", file=sys.stderr)
        return 1
    README.write_text(BLOCK.sub(lambda _: table(), text), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Words of the interface in other languages, for Blender's own translation system.

Each language is a file in `languages/`, in the format of gettext, which every translator's tool reads.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import bpy

from ..operators.data import report_text

FOLDER = Path(__file__).parent / "languages"

LANGUAGES = ("de",)
"""Names of the files, and of the languages; Blender finds them from those with a country, too, such as de_DE."""

CONTEXTS = ("*", "Operator")
"""Blender looks for the names of operators in a context of their own."""


@cache
def words(language: str) -> dict[str, str]:
    """Return the translation of each English string."""
    # a string may go on in the next line
    text = (FOLDER / f"{language}.po").read_text(encoding="utf-8").replace('"\n"', "")
    quoted = (line.partition(" ")[2] for line in text.split("\n") if line.startswith("msg"))
    strings = json.loads(f"[{','.join(quoted)}]")
    return {english: own for english, own in zip(strings[::2], strings[1::2], strict=True) if english and own}


def dictionary() -> dict[str, dict[tuple[str, str], str]]:
    """Return all languages as Blender wants them."""
    return {
        name: {(context, english): own for english, own in words(name).items() for context in CONTEXTS}
        for name in LANGUAGES
    }


def register() -> None:
    """Add the words to Blender's."""
    bpy.app.translations.register(__name__, dictionary())
    report_text.speak(bpy.app.translations.pgettext_rpt)


def unregister() -> None:
    """Remove them."""
    report_text.speak(str)
    bpy.app.translations.unregister(__name__)

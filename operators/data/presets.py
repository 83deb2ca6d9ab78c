"""Presets by name: the solver's, and those that the user saved with Blender's preset system.  Needs no NumPy."""

from __future__ import annotations

import ast
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import bpy

from ...solver.settings import PRESETS, Settings

FOLDER = "sparse_surface"

_LINE = re.compile(r"^(?:settings|bpy\.context\.scene\.sparse_surface)\.(\w+) = (.+)$", re.MULTILINE)
"""A value in a preset file: ours give the settings a name first, Blender writes the whole path."""

_read: dict[Path, tuple[int, dict[str, Any]]] = {}
"""By file: when it was written, and its values; the panel asks at every redraw."""


def preset_names() -> list[str]:
    """Return the names of all presets, the user's after the solver's."""
    return [*PRESETS, *_files()]


def preset_title(name: str) -> str:
    """Return a preset's name as menus write it: the solver's with capitals, the user's as they were typed."""
    return bpy.path.display_name(name, title_case=name in PRESETS)


def preset_named(title: str) -> str:
    """Return the name of the solver's preset with a title; other titles are names themselves."""
    return next((name for name in PRESETS if preset_title(name) == title), title)


def preset_values(name: str) -> dict[str, Any]:
    """Return the settings that a preset changes.

    Raises
    ------
    KeyError
        When there is no such preset.
    """
    return PRESETS[name] if name in PRESETS else _values(_files()[name])


def matching_preset(settings: Settings) -> str:
    """Return the name of the preset that gives these settings, or nothing.

    What runs them does not count, nor, if no preset has it, does the tolerance: that belongs to the mesh at hand.
    """
    wanted, defaults = settings.as_dict(), {item.name: item.default for item in fields(Settings)}
    offered = {name: {**defaults, **preset_values(name)} for name in preset_names()}
    for ignored in ({"workers", "solver"}, {"workers", "solver", "tolerance"}):
        for name, values in offered.items():
            if all(values[each] == wanted[each] for each in wanted if each not in ignored):
                return name
    return ""


def plain_value(value: Any) -> Any:
    """Return a property's value as the solver's settings hold it: 0.2, not the nearest single-precision number."""
    return float(f"{value:.7g}") if isinstance(value, float) else value


def _files() -> dict[str, Path]:
    """Return the user's preset files by name."""
    folders = [Path(folder) for folder in bpy.utils.preset_paths(FOLDER)]
    found = {path.stem: path for folder in folders for path in folder.glob("*.py")}
    return {name: found[name] for name in sorted(found) if name not in PRESETS}


def _values(path: Path) -> dict[str, Any]:
    written = path.stat().st_mtime_ns
    if _read.get(path, (0, {}))[0] != written:
        known = {item.name for item in fields(Settings)}
        lines = _LINE.findall(path.read_text(encoding="utf-8"))
        values = {name: plain_value(ast.literal_eval(value)) for name, value in lines if name in known}
        _read[path] = written, values
    return _read[path][1]

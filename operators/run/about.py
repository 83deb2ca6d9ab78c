"""What the add-on says of itself: where its pages are, and what it runs on."""

from __future__ import annotations

import platform
import re
import tomllib
from functools import cache
from pathlib import Path

import bpy
from bpy.types import Context

from ...solver.native.library import reason_against
from ...solver.version import VERSION
from .preferences import preferences
from .requirements import package_versions

MANIFEST = Path(__file__).parents[2] / "blender_manifest.toml"
CHANGELOG = Path(__file__).parents[2] / "CHANGELOG.md"

IN_SHORT = re.compile(r"^### In short\n(.*?)(?=^#|\Z)", re.MULTILINE | re.DOTALL)
"""The newest version comes first, and its most important changes before all others."""


@cache
def website() -> str:
    """Return the address that the manifest gives, or nothing."""
    try:
        return str(tomllib.loads(MANIFEST.read_text(encoding="utf-8")).get("website", "")).rstrip("/")
    except OSError:
        return ""


def bug_page() -> str:
    """Return the address where bugs are reported, or nothing."""
    return f"{website()}/issues" if website() else ""


@cache
def news() -> tuple[str, ...]:
    """Return what is new in this version, a sentence or two each; nothing where the changelog is missing."""
    try:
        found = IN_SHORT.search(CHANGELOG.read_text(encoding="utf-8"))
    except OSError:
        return ()
    entries = re.split(r"^- ", found[1], flags=re.MULTILINE)[1:] if found is not None else []
    return tuple(" ".join(entry.split()) for entry in entries)


def was_updated(context: Context) -> bool:
    """Whether this version has replaced another one, and the user has not yet looked at what is new."""
    own = preferences(context)
    return own is not None and bool(own.seen_version) and own.seen_version != VERSION


def note_version(context: Context) -> None:
    """Remember that the user knows this version."""
    own = preferences(context)
    if own is not None and own.seen_version != VERSION:
        own.seen_version = VERSION
        context.preferences.is_dirty = True  # so that Blender saves it with the preferences


def system_text() -> str:
    """Return what a bug report needs to know: the versions of everything, a line each."""
    kernel = reason_against()
    lines = {
        "Sparse Surface": VERSION,
        "Blender": f"{bpy.app.version_string} ({bpy.app.build_hash.decode()})",
        "System": f"{platform.platform()}, {platform.machine()}",
        "Python": platform.python_version(),
        **package_versions(),
        "Compiled kernel": "in use" if kernel is None else kernel,
    }
    return "\n".join(f"{name}: {value}" for name, value in lines.items())

"""What the add-on says of itself: where its pages are, and what it runs on."""

from __future__ import annotations

import platform
import tomllib
from functools import cache
from pathlib import Path

import bpy

from ...solver.native.library import reason_against
from ...solver.version import VERSION
from .requirements import package_versions

MANIFEST = Path(__file__).parents[2] / "blender_manifest.toml"


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

"""What is new: named once after an update, in the changelog's words, and again whenever the user asks."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from bl_ext.user_default.sparse_surface.operators import whats_new
from bl_ext.user_default.sparse_surface.operators.run import about
from bl_ext.user_default.sparse_surface.solver.version import VERSION
from bl_ext.user_default.sparse_surface.ui import panels

sys.path.insert(0, str(Path(__file__).parent))
import scenes
from test_panels import Recorder, drawn

CHANGELOG = Path(__file__).resolve().parents[2] / "CHANGELOG.md"


@pytest.fixture
def own() -> Iterator[Any]:
    preferences = bpy.context.preferences.addons[scenes.EXTENSION].preferences
    yield preferences
    preferences.seen_version = VERSION


def is_announced() -> bool:
    return ("operator", "sparse_surface.whats_new") in drawn(panels.SPARSE_SURFACE_PT_main)


def test_a_first_installation_announces_nothing(own: Any):
    assert own.seen_version == VERSION
    assert not is_announced()


def test_an_update_is_announced_until_the_user_has_looked(own: Any):
    own.seen_version = "0.0.9"
    assert is_announced()
    assert bpy.ops.sparse_surface.whats_new() == {"FINISHED"}
    assert own.seen_version == VERSION
    assert not is_announced()


def test_every_sentence_of_the_changelog_is_shown():
    """In lines that the pop-up can hold, none of them lost; the changelog itself is the oracle."""
    seen: list[tuple[str, Any]] = []
    whats_new.SPARSE_SURFACE_OT_whats_new.draw(SimpleNamespace(layout=Recorder(seen)), bpy.context)
    lines = [text for kind, text in seen if kind == "label"]
    assert VERSION in lines[0]
    assert max(map(len, lines)) <= whats_new.CHARACTERS
    newest = CHANGELOG.read_text(encoding="utf-8").split("\n### In short\n")[1].split("\n###")[0]
    assert " ".join(lines[1:]) == " ".join(newest.replace("\n- ", "\n").split())
    assert 3 <= len(about.news()) <= 10

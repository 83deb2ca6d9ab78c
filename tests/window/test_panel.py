"""The sidebar: what it shows for each kind of selection, and how long it takes to draw."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import driver


def test_panel_shows_settings_and_estimate():
    driver.clear_scene()
    driver.add_creased_grid(60)
    yield from driver.open_sidebar()
    driver.shot("panel")
    with driver.in_viewport():
        assert bpy.ops.sparse_surface.approximate.poll()


def test_button_is_disabled_without_a_mesh():
    driver.clear_scene()
    yield 0.2
    with driver.in_viewport():
        assert not bpy.ops.sparse_surface.approximate.poll()
    driver.shot("panel_without_selection")


if __name__ == "__main__":
    driver.run(test_panel_shows_settings_and_estimate, test_button_is_disabled_without_a_mesh)

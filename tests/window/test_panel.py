"""The sidebar: what it shows for each kind of selection, and how long it takes to draw."""

from __future__ import annotations

import sys
import time
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


def test_enabling_costs_little():
    """Importing and registering anew, in processor time: Blender starts with it every day."""
    import addon_utils

    name = driver.add_on()
    addon_utils.disable(name)
    for loaded in [each for each in sys.modules if each.startswith(name)]:
        del sys.modules[loaded]
    before = time.process_time()
    addon_utils.enable(name)
    spent = time.process_time() - before
    print(f"enabling took {1000 * spent:.0f} ms of processor time")
    yield 0.5
    assert spent < 0.05


if __name__ == "__main__":
    driver.run(
        test_panel_shows_settings_and_estimate,
        test_button_is_disabled_without_a_mesh,
        test_enabling_costs_little,
    )

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


def test_drawing_costs_little():
    """All panels of the sidebar together, in processor time, once they have been drawn before."""
    panels = [*driver.module("ui.panels").CLASSES, *driver.module("ui.inspect_panel").CLASSES]
    panels = [each for each in panels if issubclass(each, bpy.types.Panel)]
    assert len(panels) > 3
    spent = dict.fromkeys(panels, 0.0)
    originals = {panel: panel.draw for panel in panels}

    def timed(panel):
        def draw(self, context):
            before = time.process_time()
            originals[panel](self, context)
            spent[panel] = time.process_time() - before

        return draw

    driver.clear_scene()
    driver.add_creased_grid(60)
    yield from driver.open_sidebar()
    for panel in panels:
        panel.draw = timed(panel)
    try:
        driver.region("UI").tag_redraw()
        yield 0.5
    finally:
        for panel in panels:
            panel.draw = originals[panel]
    print(f"drawn in {1e3 * sum(spent.values()):.1f} ms of processor time", flush=True)
    assert 0.0 < sum(spent.values()) < 0.05


def test_enabling_costs_little():
    """Importing and registering again, in processor time: Blender starts with it every day."""
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
        test_drawing_costs_little,
        test_enabling_costs_little,
    )

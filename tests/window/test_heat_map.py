"""The heat map in a viewport: error colours, legend, and the way back to what was shown before."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import driver

drawn: list[str] = []


def solve(name: str = "Creased") -> driver.Steps:
    """Solve a small sheet and look at the result from near."""
    driver.clear_scene()
    bpy.context.scene.sparse_surface.iterations = 4
    bpy.context.scene.sparse_surface.sweeps = 0
    driver.add_creased_grid(40, name)
    yield 0.2
    driver.approximate()
    yield from driver.wait_for(lambda: driver.running() is None, 240.0, "result")
    with driver.in_viewport():
        bpy.ops.view3d.view_selected()
    yield 0.5
    return bpy.context.view_layer.objects.active


def toggle() -> None:
    with driver.in_viewport():
        assert bpy.ops.sparse_surface.show_heat_map() == {"FINISHED"}


def count_drawn_words() -> list[str]:
    """Collect every word that the legend draws from now on."""
    import blf

    drawn.clear()
    if not hasattr(blf, "plain_draw"):
        blf.plain_draw = blf.draw
        blf.draw = lambda font, text: (drawn.append(text), blf.plain_draw(font, text))[1]
    return drawn


def test_button_shows_colours_and_legend_and_restores_the_shading():
    yield from solve()
    space = driver.viewport().spaces.active
    space.shading.type = "WIREFRAME"
    yield 1.0
    words = count_drawn_words()
    toggle()
    driver.viewport().tag_redraw()
    yield 0.5
    assert (space.shading.type, space.shading.color_type) == ("SOLID", "VERTEX")
    assert space.local_view is not None
    assert any(word.startswith("Error") for word in words), words
    assert len(set(words)) >= 6
    driver.shot("heat_map")
    yield from driver.open_sidebar()
    driver.shot("heat_map_with_sidebar")
    toggle()
    words.clear()
    driver.viewport().tag_redraw()
    yield 0.5
    assert space.shading.type == "WIREFRAME"
    assert space.local_view is None
    assert not words, words
    space.shading.type = "SOLID"
    assert space.shading.color_type == "MATERIAL"


def test_tolerance_mode_has_two_colours():
    made = yield from solve()
    display = bpy.context.scene.sparse_surface.display
    words = count_drawn_words()
    toggle()
    display.inside_outside = True
    display.tolerance = made["sparse_surface"]["vertex_error"]["p95"]
    driver.viewport().tag_redraw()
    yield 0.5
    assert {"inside", "outside"} <= set(words)
    driver.shot("heat_map_tolerance")
    toggle()
    yield 0.2


def test_fixed_range_and_feet_are_what_the_legend_says():
    yield from solve()
    display = bpy.context.scene.sparse_surface.display
    display.range_mode = "FIXED"
    display.range_maximum = 0.3048
    bpy.context.scene.unit_settings.system = "IMPERIAL"
    bpy.context.scene.unit_settings.length_unit = "FEET"
    words = count_drawn_words()
    toggle()
    yield 0.5
    assert {"Error [ft]", "0.0", "1.0"} <= set(words) or {"Error [ft]", "0", "1"} <= set(words), words
    bpy.context.scene.unit_settings.system = "METRIC"
    bpy.context.scene.unit_settings.length_unit = "METERS"
    toggle()
    yield 0.2


def test_statistics_are_copied():
    made = yield from solve()
    with driver.in_viewport():
        bpy.ops.sparse_surface.copy_statistics(form="TEXT")
        text = bpy.context.window_manager.clipboard
        assert text.startswith(made.name)
        assert str(made["sparse_surface"]["patches"]) in text
        bpy.ops.sparse_surface.copy_statistics(form="JSON")
    import json

    assert json.loads(bpy.context.window_manager.clipboard)["patches"] == made["sparse_surface"]["patches"]


if __name__ == "__main__":
    driver.run(*(value for name, value in list(globals().items()) if name.startswith("test_")))

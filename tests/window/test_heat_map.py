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
    driver.add_creased_grid(20, name)
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
    assert {"inside", "outside"} <= {word.split()[0] for word in words}
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


def words_drawn() -> driver.Steps:
    """Draw once more, and return the words of the legend."""
    words = count_drawn_words()
    driver.viewport().tag_redraw()
    yield 0.4
    return set(words)


def test_it_is_saved_with_the_file_and_restored_whole():
    made = yield from solve()
    space = driver.viewport().spaces.active
    space.shading.type = "WIREFRAME"
    toggle()
    name, path = made.name, str(driver.FOLDER / "heat_map.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, compress=False)
    toggle()
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=True)
    yield 1.0
    space = driver.viewport().spaces.active
    assert driver.module("operators.heat_map.shown").shows_heat_map(space)
    bpy.context.view_layer.objects.active = bpy.data.objects[name]
    words = yield from words_drawn()
    assert any(word.startswith("Error") for word in words), words
    driver.shot("heat_map_loaded")
    toggle()
    yield 0.3
    assert space.shading.type == "WIREFRAME"
    assert space.local_view is None
    space.shading.type = "SOLID"
    assert space.shading.color_type == "MATERIAL"


def test_it_survives_undo_redo_and_modes():
    made = yield from solve()
    name = made.name
    shown = driver.module("operators.heat_map.shown")
    toggle()
    with driver.in_viewport():
        bpy.ops.transform.translate("EXEC_DEFAULT", True, value=(0.0, 0.0, 0.25))
    yield 0.3
    for ctrl in ({"ctrl": True}, {"ctrl": True, "shift": True}, {"ctrl": True}):
        driver.press("Z", **ctrl)
        yield 0.5
        space = driver.viewport().spaces.active
        assert shown.shows_heat_map(space)
        assert driver.module("operators.data.viewports").is_shown_in(space, bpy.data.objects[name], bpy.context)
        words = yield from words_drawn()
        assert any(word.startswith("Error") for word in words), words
    for mode in ("EDIT", "OBJECT", "SCULPT", "OBJECT"):
        with driver.in_viewport():
            bpy.ops.object.mode_set(mode=mode)
        words = yield from words_drawn()
        assert shown.shows_heat_map(driver.viewport().spaces.active)
        assert any(word.startswith("Error") for word in words), (mode, words)
    toggle()
    yield 0.2
    assert driver.viewport().spaces.active.shading.color_type == "MATERIAL"


def test_the_legend_is_there_only_while_the_colours_are():
    yield from solve()
    toggle()
    space = driver.viewport().spaces.active
    assert (yield from words_drawn())
    space.overlay.show_overlays = False
    assert not (yield from words_drawn())
    space.overlay.show_overlays = True
    for kind in ("WIREFRAME", "MATERIAL"):
        space.shading.type = kind
        assert not (yield from words_drawn()), kind
    space.shading.type = "SOLID"
    assert (yield from words_drawn())
    toggle()
    yield 0.2


def test_hide_the_rest_works_while_it_is_on():
    yield from solve()
    display = bpy.context.scene.sparse_surface.display
    toggle()
    space = driver.viewport().spaces.active
    assert space.local_view is not None
    display.isolate = False
    yield 0.2
    assert space.local_view is None
    display.isolate = True
    yield 0.2
    assert space.local_view is not None
    toggle()
    yield 0.2
    assert space.local_view is None


def test_two_visible_results_share_one_range_and_its_end_is_the_figure_of_the_panel():
    one = yield from solve()
    other = one.copy()
    other.data = one.data.copy()
    bpy.context.scene.collection.objects.link(other)
    largest = other["sparse_surface"]["vertex_error"]["max"]
    for element in other.data.attributes["error"].data:
        element.value *= 3.0
    toggle()
    yield 0.5
    assert list(one["error_color_range"]) == list(other["error_color_range"])
    assert abs(other["error_color_range"][1] - 3.0 * largest) < 1e-6 * largest
    other.hide_set(True)
    yield 0.5
    assert abs(one["error_color_range"][1] - largest) < 1e-6 * largest
    bpy.context.view_layer.objects.active = one
    words = yield from words_drawn()
    text = driver.module("operators.data.lengths").length_text(bpy.context.scene, largest)
    assert text.split()[0] in words, (text, words)
    toggle()
    yield 0.2


def test_patches_are_seen_in_any_shading():
    made = yield from solve()
    space = driver.viewport().spaces.active
    for kind in ("MATERIAL", "WIREFRAME", "SOLID"):
        space.shading.type = kind
        with driver.in_viewport():
            assert bpy.ops.sparse_surface.show_patches("INVOKE_DEFAULT", True) == {"FINISHED"}
        assert (space.shading.type, space.shading.color_type) == ("SOLID", "VERTEX")
        assert made.data.color_attributes.active_color.name == "patch_color"
        words = yield from words_drawn()
        assert "Patches" in words, words
        driver.shot("patches")
        with driver.in_viewport():
            assert bpy.ops.sparse_surface.show_patches("INVOKE_DEFAULT", True) == {"FINISHED"}
        assert space.shading.type == kind
        assert made.data.color_attributes.active_color.name == "error_color"
    assert space.shading.color_type == "MATERIAL"


def test_the_legend_is_readable_on_white_and_at_twice_the_size():
    """A picture to look at; the layout is tested without a window."""
    yield from solve()
    space = driver.viewport().spaces.active
    toggle()
    space.shading.background_type, space.shading.background_color = "VIEWPORT", (1.0, 1.0, 1.0)
    space.overlay.show_stats = True
    yield from driver.open_sidebar()
    driver.shot("heat_map_on_white")
    bpy.context.preferences.view.ui_scale = 2.0
    space.show_region_ui = False
    yield 1.0
    driver.shot("heat_map_twice_the_size")
    bpy.context.preferences.view.ui_scale = 1.0
    space.shading.background_type = "THEME"
    yield 0.5
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

"""Blender's own ways lead to the add-on: Menu Search, right-click, dropped files, help in the sidebar."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import driver


def type_words(words: str) -> driver.Steps:
    """Type into the field that has the keys."""
    for letter in words:
        kind = "SPACE" if letter == " " else letter.upper()
        over = driver.region("WINDOW")
        place = {"x": over.x + over.width // 2, "y": over.y + over.height // 2}
        driver.window().event_simulate(type=kind, value="PRESS", unicode=letter, **place)
        driver.window().event_simulate(type=kind, value="RELEASE", **place)
        yield 0.05
    yield 0.5


def a_result() -> driver.Steps:
    driver.clear_scene()
    driver.add_creased_grid(24)
    settings = bpy.context.scene.sparse_surface
    settings.iterations, settings.sweeps = 3, 0
    assert driver.approximate() == {"RUNNING_MODAL"}
    yield from driver.wait_for(lambda: driver.running() is None, 240.0, "result")
    yield 0.5


def test_menu_search_finds_and_runs_an_operator():
    yield from a_result()
    before = len(bpy.data.objects)
    driver.press("F3")
    yield 1.0
    yield from type_words("separate patches")
    driver.shot("menu_search")
    driver.press("RET")
    yield 1.0
    driver.shot("menu_search_done")
    assert len(bpy.data.objects) > before + 3


def test_the_right_click_menu_shows_the_sub_menu():
    yield from a_result()
    driver.press("RIGHTMOUSE")
    yield 0.5
    driver.shot("right_click")
    driver.press("ESC")
    yield 0.3
    with driver.in_viewport():
        bpy.ops.wm.call_menu(name="SPARSE_SURFACE_MT_object")
    yield 0.5
    driver.shot("object_menu")
    driver.press("ESC")
    yield 0.3


def test_dropped_files_are_read():
    driver.clear_scene()
    (driver.FOLDER / "scan.xyz").write_text("0 0 0\n1 0 0\n0 1 0\n0 0 1\n")
    with driver.in_viewport():
        files = [{"name": "scan.xyz"}]
        bpy.ops.wm.drop_import_file("INVOKE_DEFAULT", directory=str(driver.FOLDER), files=files)
    yield from driver.wait_for(lambda: "scan" in bpy.data.objects, 5.0, "points")
    yield 0.3
    driver.shot("dropped")
    assert len(bpy.data.objects["scan"].data.vertices) == 4
    assert bpy.context.scene.sparse_surface.job == "RECONSTRUCT"


def test_the_file_browser_asks_for_a_file_and_can_be_left():
    yield from a_result()
    with driver.in_viewport():
        assert bpy.ops.sparse_surface.export_representation("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    yield 1.5
    areas = [area for each in bpy.context.window_manager.windows for area in each.screen.areas]
    browser = next(area for area in areas if area.type == "FILE_BROWSER")
    driver.shot("file_browser")
    assert browser.spaces.active.params.filename == "Creased_Sparse_Surface.npz"
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[-1], area=browser):
        bpy.ops.file.cancel()
    yield 0.5


def test_help_opens_in_the_sidebar_with_one_click(monkeypatch):
    driver.clear_scene()
    driver.add_creased_grid(20)
    panel, drawn = driver.module("ui.help_panel").SPARSE_SURFACE_PT_help, []
    original = panel.draw

    def draw(self, context):
        drawn.append(True)
        original(self, context)

    monkeypatch(panel, "draw", draw)
    yield from driver.open_sidebar()
    yield 0.5
    assert not drawn
    over = driver.region("UI")
    driver.click(over.x + 90, over.y + over.height - 269)
    yield 0.7
    driver.shot("help")
    assert drawn


def test_the_sample_scene_is_seen_whole():
    driver.clear_scene()
    own = bpy.context.scene
    with driver.in_viewport():
        assert bpy.ops.sparse_surface.open_sample("INVOKE_DEFAULT", True) == {"FINISHED"}
    yield 1.0
    yield from driver.open_sidebar()
    driver.shot("sample")
    assert driver.window().scene != own
    driver.window().scene = own
    yield 0.3


if __name__ == "__main__":
    driver.run(*(value for name, value in list(globals().items()) if name.startswith("test_")))

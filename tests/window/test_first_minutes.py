"""What a new user does first, with clicks and keys: a mesh that is too coarse, lengths in millimetres, presets."""

from __future__ import annotations

import json
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import driver

PRESET, USE_TOLERANCE, TOLERANCE = (0.64, 110), (0.425, 133), (0.67, 133)
SUBDIVIDE, APPROXIMATE = (0.5, 221), (0.5, 207)
"""Places in the sidebar: share of its width, pixels below its top.  Approximate moves up when nothing is too coarse."""

FIRST_PRESET, NEW_PRESET, ROW, BESIDE = 150, 271, 20.7, 0.945
"""In the list of the five presets: the first one, the field below them, from row to row; the signs beside them."""


def click(place: tuple[float, float]) -> driver.Steps:
    """Click into the sidebar, as slowly as a hand does."""
    over = driver.region("UI")
    x, y = over.x + int(over.width * place[0]), over.y + over.height - int(place[1])
    yield from click_at(x, y)


def click_at(x: int, y: int) -> driver.Steps:
    driver.window().event_simulate(type="MOUSEMOVE", value="NOTHING", x=x, y=y)
    yield 0.3
    for value in ("PRESS", "RELEASE"):
        driver.window().event_simulate(type="LEFTMOUSE", value=value, x=x, y=y)
        yield 0.1
    yield 0.4


def type_text(text: str) -> driver.Steps:
    """Type into the field that has the cursor, in place of what it holds, and confirm."""
    window = driver.window()
    window.event_simulate(type="A", value="PRESS", ctrl=True)
    window.event_simulate(type="A", value="RELEASE", ctrl=True)
    yield 0.1
    for letter in text:
        window.event_simulate(type="A", value="PRESS", unicode=letter)
        window.event_simulate(type="A", value="RELEASE")
        yield 0.05
    for value in ("PRESS", "RELEASE"):
        window.event_simulate(type="RET", value=value)
    yield 0.4


def add_cube() -> Any:
    driver.clear_scene()
    with driver.in_viewport():
        bpy.ops.mesh.primitive_cube_add()
        bpy.ops.ed.undo_push(message="Add cube")
    yield from driver.open_sidebar()
    yield 0.5
    return bpy.context.object


def result() -> driver.Steps:
    """Press Approximate, which stands where it does for a mesh that is fine enough, and wait for the result."""
    yield from click(APPROXIMATE)
    yield from driver.wait_for(lambda: len(bpy.data.objects) == 2 and driver.running() is None, 120.0, "result")
    yield 0.5
    return bpy.context.view_layer.objects.active


class Noting:
    """A layout that notes the words of its labels and buttons, and draws them."""

    def __init__(self, layout: Any, words: list[str]) -> None:
        self.__dict__.update(layout=layout, words=words)

    def __getattr__(self, name: str) -> Any:
        found = getattr(self.layout, name)
        return partial(self._call, found) if callable(found) else found

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self.layout, name, value)

    def _call(self, found: Any, *arguments: Any, **options: Any) -> Any:
        self.words.append(str(options.get("text", "")))
        made = found(*arguments, **options)
        return Noting(made, self.words) if isinstance(made, bpy.types.UILayout) else made


def words_of(panel: Any, monkeypatch: Any) -> driver.Steps:
    """Have a panel drawn in the window, and return the words on it."""
    words: list[str] = []
    original = panel.draw

    def draw(self: Any, context: Any) -> None:
        words.clear()
        stand_in = SimpleNamespace(layout=Noting(self.layout, words))
        stand_in.column = lambda context: driver.module("ui.sidebar").SidebarPanel.column(stand_in, context)
        original(stand_in, context)

    monkeypatch(panel, "draw", draw)
    driver.region("UI").tag_redraw()
    yield 0.5
    assert words, f"{panel} was not drawn"
    return words


def test_a_mesh_too_coarse_is_named_and_subdivided_by_the_button(monkeypatch):
    cube = yield from add_cube()
    panel = driver.module("ui.panels").SPARSE_SURFACE_PT_main
    words = yield from words_of(panel, monkeypatch)
    driver.shot("too_coarse")
    assert "8 vertices: too coarse to" in words
    yield from click(SUBDIVIDE)
    assert [each.type for each in cube.modifiers] == ["SUBSURF"]
    assert not any("too coarse" in each for each in words)
    (expected,) = (each for each in words if " patches, " in each)
    driver.shot("subdivided")
    made = yield from result()
    # The cube of 2 m with six faces of 256 quads: all its points lie on the cube, and nothing else is left in view.
    assert len(made.data.vertices) == 6 * 16**2 + 2
    assert max(abs(max(map(abs, vertex.co)) - 1.0) for vertex in made.data.vertices) < 1e-5
    assert cube.hide_get()
    patches = len({each.value for each in made.data.attributes["patch"].data})
    assert 0.5 < int(expected.split()[1]) / patches < 2.0


def test_lengths_are_typed_and_shown_in_the_units_of_the_scene(monkeypatch):
    """One unit of a scene in millimetres is one millimetre; what is typed in micrometres is a thousandth of it."""
    units = bpy.context.scene.unit_settings
    for name, value in (("length_unit", "MILLIMETERS"), ("scale_length", 0.001)):
        monkeypatch(units, name, value)
    yield from add_cube()
    yield from click(SUBDIVIDE)
    settings = bpy.context.scene.sparse_surface
    yield from click(USE_TOLERANCE)
    assert settings.use_tolerance
    yield from click(TOLERANCE)
    yield from type_text("50 um")
    assert abs(settings.tolerance - 0.05) < 1e-6
    made = yield from result()
    report = json.loads(made["sparse_surface"]) if isinstance(made["sparse_surface"], str) else made["sparse_surface"]
    assert abs(report["settings"]["tolerance"] - 0.05) < 1e-6
    panels = driver.module("ui.result_panel")
    words = yield from words_of(panels.SPARSE_SURFACE_PT_result, monkeypatch)
    assert "Within the tolerance (0.05 mm)" in words
    lengths = [each for each in words if each.startswith(("Typical error ", "Largest "))]
    assert len(lengths) == 2
    assert all(each.endswith(" mm") for each in lengths), lengths
    drawn: list[str] = []
    legend = driver.module("ui.legend").blf
    original = legend.draw
    monkeypatch(legend, "draw", lambda font, text: (drawn.append(text), original(font, text)))
    with driver.in_viewport():
        bpy.ops.sparse_surface.show_heat_map()
    yield 0.6
    driver.shot("millimetres")
    assert "Error [mm]" in drawn
    with driver.in_viewport():
        bpy.ops.sparse_surface.show_heat_map()
    yield 0.2


def test_presets_are_chosen_saved_and_removed_with_the_mouse(monkeypatch):
    yield from add_cube()
    yield from click(SUBDIVIDE)
    settings = bpy.context.scene.sparse_surface
    words = yield from words_of(driver.module("ui.panels").SPARSE_SURFACE_PT_main, monkeypatch)
    fast = driver.module("solver.settings").PRESETS["fast"]
    folder = Path(bpy.utils.user_resource("SCRIPTS", path="presets")) / "sparse_surface"
    file = folder / "My_own.py"
    file.unlink(missing_ok=True)
    yield from choose(2)
    assert {name: getattr(settings, name) for name in fast} == fast
    assert "Fast" in words
    settings.ring = 5
    driver.region("UI").tag_redraw()
    yield 0.3
    assert "Custom" in words
    yield from click(PRESET)
    yield from click((0.55, NEW_PRESET))
    yield from type_text("My own")
    yield from click((BESIDE, NEW_PRESET))
    driver.shot("preset_saved")
    yield from close()
    assert ".ring = 5\n" in file.read_text()
    yield from choose(0)
    assert "Default" in words
    yield from choose(3)  # in the order of the alphabet
    assert settings.ring == 5
    assert "My own" in words
    yield from choose(0, BESIDE)  # the minus sign: one that comes with the extension stays
    yield from choose(0)
    assert "Default" in words
    yield from choose(3)
    yield from choose(3, BESIDE)
    assert not file.exists()
    assert settings.ring == 5
    assert "Custom" in words


def choose(row: int, beside: float = 0.55) -> driver.Steps:
    """Click at a row of the list of presets: at its name, or at the sign that removes it."""
    yield from click(PRESET)
    yield from click((beside, FIRST_PRESET + row * ROW))
    yield from close()


def close() -> driver.Steps:
    """Close the list; moving the mouse away does the same, but not at once."""
    driver.press("ESC")
    yield 0.3
    driver.region("UI").tag_redraw()
    yield 0.3


if __name__ == "__main__":
    driver.run(
        test_a_mesh_too_coarse_is_named_and_subdivided_by_the_button,
        test_lengths_are_typed_and_shown_in_the_units_of_the_scene,
        test_presets_are_chosen_saved_and_removed_with_the_mouse,
    )

"""What a run does to the scene: one surface in one place, the source within reach, and the button pressed again."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import driver


def solved(**settings: Any) -> driver.Steps:
    """Press the button with what is selected and wait for the result."""
    for name, value in {"iterations": 4, "sweeps": 0, **settings}.items():
        setattr(bpy.context.scene.sparse_surface, name, value)
    assert driver.approximate() == {"RUNNING_MODAL"}
    yield from driver.wait_for(lambda: driver.running() is None, 240.0, "result")
    yield 0.5
    return bpy.context.view_layer.objects.active


def visible() -> set[str]:
    return {o.name for o in bpy.context.view_layer.objects if o.visible_get()}


def positions(placed: Any) -> Any:
    return driver.scenes.positions(placed.data).copy()


def press_show_source(**arguments: Any) -> driver.Steps:
    with driver.in_viewport():
        assert bpy.ops.sparse_surface.show_source("INVOKE_DEFAULT", True, **arguments) == {"FINISHED"}
    yield 0.3


def test_one_surface_is_seen_and_one_click_brings_both_back():
    driver.clear_scene()
    sheet = driver.add_creased_grid(30)
    made = yield from solved()
    assert visible() == {driver.RESULT}
    with driver.in_viewport():
        bpy.ops.view3d.view_selected()
    yield 0.5
    driver.shot("source_hidden")
    yield from press_show_source()
    assert visible() == {"Creased", driver.RESULT}
    yield from press_show_source()
    yield from press_show_source(beside=True)
    with driver.in_viewport():
        bpy.ops.view3d.view_all()
    yield 0.5
    driver.shot("source_beside")
    assert driver.scenes.world_positions(sheet)[:, 0].max() < driver.scenes.world_positions(made)[:, 0].min()


def test_pressing_again_with_the_result_selected_solves_the_source():
    driver.clear_scene()
    sheet = driver.add_creased_grid(30)
    sheet.modifiers.new("Array", "ARRAY")
    made = yield from solved()
    first, name = positions(made), made.name
    assert bpy.context.selected_objects == [made]
    again = yield from solved()
    assert again.name == name
    assert {o.name for o in bpy.data.objects} == {"Creased", name}
    assert np.array_equal(positions(again), first)
    assert visible() == {name}
    with driver.in_viewport():
        bpy.ops.ed.undo()
    yield 0.3
    assert {o.name for o in bpy.data.objects} == {"Creased", name}
    with driver.in_viewport():
        bpy.ops.ed.undo()
    yield 0.3
    assert visible() == {"Creased"}


def test_pressing_again_in_local_view_stays_in_it():
    driver.clear_scene()
    driver.add_creased_grid(24)
    with driver.in_viewport():
        bpy.ops.view3d.localview()
    yield 0.3
    space = driver.viewport().spaces.active
    for replace in (True, False):
        made = yield from solved(replace_result=replace)
        seen = made.evaluated_get(bpy.context.evaluated_depsgraph_get())
        assert seen.visible_in_viewport_get(space)
    with driver.in_viewport():
        bpy.ops.view3d.localview()


def test_a_curve_is_converted_by_the_button_beside():
    """Clicked where the panel draws it, below the button of which it says why it is grey."""
    driver.clear_scene()
    with driver.in_viewport():
        bpy.ops.curve.primitive_bezier_circle_add()
    curve = bpy.context.view_layer.objects.active
    curve.data.extrude = 0.5
    yield from driver.open_sidebar()
    yield 0.5
    driver.shot("way_on_curve")
    panel = driver.region("UI")
    x = panel.x + panel.width // 2
    for y in range(panel.y + panel.height - 150, panel.y + panel.height - 420, -8):
        if curve.type == "MESH" or len(bpy.data.meshes):
            break
        driver.click(x, y)
        yield 0.2
    driver.shot("way_on_converted")
    assert bpy.context.view_layer.objects.active.type == "MESH"


def test_a_result_runs_again_with_its_own_settings_changed():
    """Its dialog shows them; leaving it gives the panel back what it had, confirming it runs."""
    driver.clear_scene()
    driver.add_creased_grid(30)
    made = yield from solved(ring=5)
    name, settings = made.name, bpy.context.scene.sparse_surface
    settings.ring = 7
    over = driver.region("WINDOW")
    place = {"x": over.x + 200, "y": over.y + 300}
    driver.window().event_simulate(type="MOUSEMOVE", value="NOTHING", **place)
    yield 0.2
    with driver.in_viewport():
        bpy.ops.sparse_surface.run_again("INVOKE_DEFAULT")
    yield 0.7
    driver.shot("run_again")
    assert settings.ring == 5
    driver.window().event_simulate(type="ESC", value="PRESS", **place)
    yield 0.5
    assert settings.ring == 7
    driver.window().event_simulate(type="MOUSEMOVE", value="NOTHING", **place)
    with driver.in_viewport():
        bpy.ops.sparse_surface.run_again("INVOKE_DEFAULT")
    yield 0.7
    settings.ring = 4  # as a field of the dialog does
    driver.window().event_simulate(type="RET", value="PRESS", **place)
    yield from driver.wait_for(lambda: driver.running() is not None, 5.0, "second run")
    yield from driver.wait_for(lambda: driver.running() is None, 240.0, "second result")
    yield 0.5
    assert {o.name for o in bpy.data.objects} == {"Creased", name}
    assert bpy.data.objects[name]["sparse_surface"]["settings"]["ring"] == 4
    driver.press("Z", ctrl=True)
    yield 0.5
    assert bpy.data.objects[name]["sparse_surface"]["settings"]["ring"] == 5


def test_the_surface_goes_to_the_source_and_one_undo_takes_it_back():
    driver.clear_scene()
    sheet = driver.add_creased_grid(30)
    before = positions(sheet)
    made = yield from solved()
    wanted, name = positions(made), made.name
    yield from driver.open_sidebar()
    driver.shot("apply_to_source_before")
    with driver.in_viewport():
        assert bpy.ops.sparse_surface.apply_to_source("INVOKE_DEFAULT", True) == {"FINISHED"}
    yield 0.3
    driver.shot("apply_to_source_after")
    assert visible() == {"Creased"}
    assert np.array_equal(positions(bpy.data.objects["Creased"]), wanted)
    driver.press("Z", ctrl=True)
    yield 0.5
    assert visible() == {name}
    assert np.array_equal(positions(bpy.data.objects["Creased"]), before)


def test_a_result_is_compared_with_its_hidden_source():
    driver.clear_scene()
    sheet = driver.add_creased_grid(30)
    sheet.modifiers.new("Array", "ARRAY")
    made = yield from solved()
    largest = made["sparse_surface"]["vertex_error"]["max"]
    made.data.attributes.remove(made.data.attributes["error"])
    with driver.in_viewport():
        assert bpy.ops.sparse_surface.compare("INVOKE_DEFAULT", True) == {"FINISHED"}
    yield 0.3
    assert abs(float(driver.scenes.values(made.data, "error").max()) - largest) < 1e-3 * largest
    assert visible() == {driver.RESULT}


def half(name: str, below: bool) -> Any:
    """Return half a ball, whose border lies on the other's."""
    circles = np.linspace(-1.0, 0.0, 9) if below else np.linspace(0.0, 1.0, 9)
    turns = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
    heights, angles = (part.ravel() for part in np.meshgrid(0.49 * np.pi * circles, turns, indexing="ij"))
    place = np.stack([np.cos(heights) * np.cos(angles), np.cos(heights) * np.sin(angles), np.sin(heights)], axis=1)
    one, beside = (np.add.outer(32 * np.arange(8), step % 32).ravel() for step in (np.arange(32), np.arange(1, 33)))
    faces = np.stack([one, beside, beside + 32, one + 32], axis=1)
    return driver.scenes.mesh_object(name, place, faces.tolist())


def test_parts_are_resampled_together_and_joined_to_one():
    driver.clear_scene()
    parts = [half("Lower", True), half("Upper", False)]
    driver.select(*parts)
    yield from solved()
    results = {f"{each.name} Sparse Surface" for each in parts}
    assert visible() == results
    driver.select(bpy.data.objects["Upper Sparse Surface"])
    with driver.in_viewport():
        bpy.ops.view3d.view_all()
        assert bpy.ops.sparse_surface.resample("INVOKE_DEFAULT", True, splits=3) == {"FINISHED"}
    yield 0.5
    driver.shot("parts_resampled")
    assert visible() == {f"{name} Resampled" for name in results}
    borders = []
    for name in sorted(results):
        fine = bpy.data.objects[f"{name} Resampled"]
        points, count = positions(fine), np.zeros(len(fine.data.vertices), dtype=int)
        for face in fine.data.polygons:
            count[list(face.vertices)] += 1
        borders.append({tuple(point) for point in points[(count == 2) & (np.abs(points[:, 2]) < 0.5)].tolist()})
    assert len(borders[0]) == 96
    assert borders[0] == borders[1]
    with driver.in_viewport():
        bpy.ops.ed.undo()
    yield 0.5
    assert visible() == results
    for name in ("Lower", "Upper"):
        bpy.data.objects[name].hide_set(False)
    driver.select(bpy.data.objects["Upper"], bpy.data.objects["Lower"])
    with driver.in_viewport():
        assert bpy.ops.object.join() == {"FINISHED"}
    yield from solved()
    driver.shot("parts_joined")
    assert visible() == {"Lower Sparse Surface"}


if __name__ == "__main__":
    driver.run(*(value for name, value in list(globals().items()) if name.startswith("test_")))

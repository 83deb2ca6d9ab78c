"""Distances in a viewport: measured from the panel, shown with a histogram, read off with the mouse, selected."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import driver

HEIGHT = 0.25


def two_sheets() -> driver.Steps:
    """Make a flat sheet, and above it another one that rises to the right; both are selected, the second is active."""
    driver.clear_scene()
    made = []
    for name, rise in (("Truth", 0.0), ("Part", 1.0)):
        vertices = [(x / 10 - 1, y / 10 - 1, HEIGHT * rise * x / 20) for x in range(21) for y in range(21)]
        corners = [21 * x + y for x in range(20) for y in range(20)]
        made.append(driver.scenes.mesh_object(name, vertices, [(c, c + 21, c + 22, c + 1) for c in corners]))
    driver.select(*made)
    bpy.context.scene.sparse_surface.job = "MEASURE"
    with driver.in_viewport():
        bpy.ops.ed.undo_push(message="Add sheets")
        bpy.ops.view3d.view_axis(type="TOP")
        bpy.ops.view3d.view_selected()
    yield 0.6
    return made


def measure(**settings: Any) -> driver.Steps:
    """Press Measure Distance and wait for the object with the distances."""
    bpy.context.scene.sparse_surface.measurement.samples = 2000
    with driver.in_viewport():
        assert bpy.ops.sparse_surface.distance("INVOKE_DEFAULT", True, **settings) == {"RUNNING_MODAL"}
    yield from driver.wait_for(lambda: driver.running() is None, 120.0, "distances")
    yield 0.4
    return bpy.context.view_layer.objects.active


def on_screen(place: tuple[float, float, float]) -> tuple[int, int]:
    """Return where a place in the world is in the window."""
    from bpy_extras.view3d_utils import location_3d_to_region_2d

    over = driver.region("WINDOW")
    at = location_3d_to_region_2d(over, driver.viewport().spaces.active.region_3d, place)
    return over.x + round(at.x), over.y + round(at.y)


def move(place: tuple[float, float, float]) -> driver.Steps:
    x, y = on_screen(place)
    driver.window().event_simulate(type="MOUSEMOVE", value="NOTHING", x=x, y=y)
    yield 0.3


def end_heat_map() -> driver.Steps:
    with driver.in_viewport():
        bpy.ops.sparse_surface.show_heat_map()
    yield 0.2


def test_measuring_shows_the_distances_with_their_histogram():
    yield from two_sheets()
    yield from driver.open_sidebar()
    driver.shot("measure_before")
    bpy.context.scene.sparse_surface.measurement.signed = True
    made = yield from measure()
    shown = driver.module("operators.heat_map.shown")
    assert shown.shows_heat_map(driver.viewport().spaces.active)
    assert made.name == "Part Distance"
    assert bpy.data.objects["Part"].hide_get()
    low, high, _ = made["error_color_range"]
    assert (low, high) == (-high, high)
    assert abs(high - HEIGHT) < 1e-5
    # The part rises evenly from 0, so the upper half of the range holds everything, in equal shares.
    shares = list(made["error_color_shares"])
    assert abs(sum(shares) - 1.0) < 1e-6
    assert sum(shares[:20]) < 1e-6
    assert max(shares[20:]) < 0.11
    driver.shot("measured")
    yield from end_heat_map()


def test_bands_say_their_shares_and_what_is_above_can_be_selected():
    yield from two_sheets()
    display = bpy.context.scene.sparse_surface.display
    display.inside_outside, display.tolerance = True, HEIGHT / 2.0
    bpy.context.scene.sparse_surface.measurement.signed = True
    made = yield from measure()
    below, within, above = made["error_color_shares"]
    assert below == 0.0
    assert abs(within - 0.5) < 0.03  # half of the part; the vertices at the border count as a whole
    assert abs(above - 0.5) < 0.03
    driver.shot("measured_bands")
    with driver.in_viewport():
        assert bpy.ops.sparse_surface.select_above("INVOKE_DEFAULT", True) == {"FINISHED"}
    made.update_from_editmode()
    chosen = [vertex.co.z for vertex in made.data.vertices if vertex.select]
    assert len(chosen) in {21 * 9, 21 * 10}  # the middle row lies on the border, as far as rounding tells
    assert min(chosen) > HEIGHT / 2.0 - 1e-6
    yield 0.3
    driver.shot("measured_above")
    with driver.in_viewport():
        bpy.ops.object.mode_set(mode="OBJECT")
    yield from end_heat_map()


def test_the_mouse_reads_values_and_a_click_keeps_them():
    yield from two_sheets()
    yield from measure()
    readings = driver.module("operators.heat_map.readings").readings
    with driver.in_viewport():
        assert bpy.ops.sparse_surface.read_values("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    yield from move((0.5, 0.2, 0.0))
    under = readings.under_mouse
    assert under is not None
    assert under.name == "Part Distance"
    assert abs(under.value - HEIGHT * 0.75) < 1e-5  # at x = 0.5, three quarters of the way
    assert (under.place - under.partner).length - under.value < 1e-5
    assert abs(under.partner.z) < 1e-6  # on the truth
    driver.click(*on_screen((0.5, 0.2, 0.0)))
    yield 0.3
    driver.click(*on_screen((-0.5, 0.2, 0.0)))
    yield 0.3
    assert [round(kept.value / HEIGHT, 2) for kept in readings.kept] == [0.75, 0.25]
    driver.shot("readings")
    yield from move((3.0, 0.2, 0.0))
    assert readings.under_mouse is None  # beside the part
    assert len(readings.kept) == 2
    driver.press("ESC")
    yield 0.3
    assert not readings.going_on
    assert not readings.kept
    driver.click(*on_screen((0.5, 0.2, 0.0)))  # the mouse selects again
    yield 0.3
    assert not readings.kept
    yield from end_heat_map()


def test_reading_ends_by_a_right_click_and_by_the_button():
    yield from two_sheets()
    yield from measure()
    readings = driver.module("operators.heat_map.readings").readings
    for way in ("click", "button"):
        with driver.in_viewport():
            assert bpy.ops.sparse_surface.read_values("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
        yield from move((0.5, 0.2, 0.0))
        assert readings.under_mouse is not None
        if way == "click":
            driver.press("RIGHTMOUSE")
        else:
            with driver.in_viewport():
                assert bpy.ops.sparse_surface.read_values("INVOKE_DEFAULT") == {"FINISHED"}
        yield 0.3
        assert not readings.going_on, way
        yield from move((0.4, 0.2, 0.0))
        assert readings.under_mouse is None, way
    yield from end_heat_map()


def test_several_parts_share_one_truth_and_one_scale():
    truth, part = yield from two_sheets()
    second = part.copy()
    second.name, second.location.x = "Second", 3.0
    bpy.context.scene.collection.objects.link(second)
    second.location = (0.0, 0.0, HEIGHT)
    bpy.context.scene.sparse_surface.measurement.reference = truth
    driver.select(second, part)
    yield from measure()
    made = {each.name: each for each in bpy.data.objects if each.name.endswith(" Distance")}
    assert set(made) == {"Part Distance", "Second Distance"}
    ranges = [list(each["error_color_range"]) for each in made.values()]
    assert ranges[0] == ranges[1]
    assert abs(ranges[0][1] - 2.0 * HEIGHT) < 1e-5  # the farthest point of both
    driver.shot("two_parts")
    yield from measure()  # what was measured is selected: measured again, and replaced
    assert {each.name for each in bpy.data.objects if each.name.endswith(" Distance")} == set(made)
    yield from end_heat_map()


if __name__ == "__main__":
    driver.run(*(value for name, value in list(globals().items()) if name.startswith("test_")))

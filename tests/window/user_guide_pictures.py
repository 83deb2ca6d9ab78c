"""Takes the pictures of docs/user-guide.md in a Blender window; run like a test, the pictures go into FOLDER."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import driver


def take_pictures() -> driver.Steps:
    driver.clear_scene()
    with driver.in_viewport():
        bpy.ops.mesh.primitive_monkey_add()
        source = bpy.context.view_layer.objects.active
        modifier = source.modifiers.new("Subdivision", "SUBSURF")
        modifier.levels = 2
        bpy.ops.object.shade_smooth()
        bpy.ops.view3d.view_axis(type="FRONT")
        bpy.ops.view3d.view_orbit(angle=0.5, type="ORBITLEFT")
        bpy.ops.view3d.view_orbit(angle=0.25, type="ORBITUP")
        bpy.ops.view3d.view_selected()
    driver.viewport().spaces.active.overlay.show_floor = False
    yield from driver.open_sidebar()
    yield 0.5
    driver.shot("guide_panel")
    bpy.context.scene.sparse_surface.preview_kind = "DRAWN"  # as Automatic does it with a graphics card
    preview = driver.module("operators.preview.controller")
    preview.REST, rest = 1.0, preview.REST  # there are as many previews as where they are drawn quickly
    driver.approximate()
    yield from driver.wait_for(lambda: driver.running().progress, 120.0, "first word of the solver")
    yield from driver.wait_for(driver.drawn_objects, 60.0, "first look")
    yield 0.5
    driver.shot("guide_progress")
    yield from driver.wait_for(lambda: driver.running().progress.fraction > 0.55, 300.0, "much of the work")
    yield 0.6
    driver.shot("guide_improving")
    preview.REST = rest
    yield from driver.wait_for(lambda: driver.running() is None, 300.0, "result")
    with driver.in_viewport():
        bpy.ops.sparse_surface.show_heat_map()
        bpy.context.scene.sparse_surface.display.range_mode = "PERCENTILE"
        bpy.context.scene.sparse_surface.display.range_percentile = 99.0
    yield 1.0
    driver.shot("guide_heat_map")
    with driver.in_viewport():
        bpy.context.scene.sparse_surface.display.inside_outside = True
        bpy.context.scene.sparse_surface.display.tolerance = 0.003
    yield 1.0
    driver.shot("guide_tolerance")
    with driver.in_viewport():
        bpy.ops.sparse_surface.show_heat_map()
    yield from take_picture_of_distances(source)


def take_picture_of_distances(source: bpy.types.Object) -> driver.Steps:
    """Measure the result from its source, and keep a reading of two places."""
    from bpy_extras.view3d_utils import location_3d_to_region_2d

    settings = bpy.context.scene.sparse_surface
    settings.display.inside_outside, settings.display.range_mode = False, "AUTOMATIC"
    settings.job, settings.measurement.signed = "MEASURE", True
    result = bpy.context.view_layer.objects.active
    source.hide_set(False)
    driver.select(source, result)
    with driver.in_viewport():
        bpy.ops.sparse_surface.distance("INVOKE_DEFAULT", True)
    yield from driver.wait_for(lambda: driver.running() is None, 300.0, "distances")
    source.hide_set(True)
    yield 0.5
    with driver.in_viewport():
        bpy.ops.sparse_surface.read_values("INVOKE_DEFAULT")
    over, view = driver.region("WINDOW"), driver.viewport().spaces.active.region_3d
    for place in ((-0.35, -0.7, 0.25), (0.3, -0.75, 0.55)):
        at = location_3d_to_region_2d(over, view, place)
        driver.click(over.x + round(at.x), over.y + round(at.y))
        yield 0.5
    driver.shot("guide_measure")


if __name__ == "__main__":
    driver.run(take_pictures)

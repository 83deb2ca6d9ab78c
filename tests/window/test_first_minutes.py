"""What a new user does first, with real clicks and keys: a mesh too coarse, lengths in millimetres, presets."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import driver


def test_look():
    driver.clear_scene()
    with driver.in_viewport():
        bpy.ops.mesh.primitive_cube_add()
    yield from driver.open_sidebar()
    yield 0.5
    driver.shot("cube")
    with driver.in_viewport():
        bpy.ops.sparse_surface.subdivide()
    yield 0.5
    driver.shot("subdivided")
    bpy.context.scene.unit_settings.length_unit = "MILLIMETERS"
    bpy.context.scene.sparse_surface.use_tolerance = True
    bpy.context.scene.sparse_surface.tolerance = 0.0123
    yield 0.5
    driver.shot("mm")
    print(driver.region("UI").width, driver.region("UI").height, driver.region("UI").x)


if __name__ == "__main__":
    driver.run(test_look)

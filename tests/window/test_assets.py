"""The assets in a window: found in the asset browser, and seen in Material Preview and Eevee without a script."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import driver


def listed() -> list[str]:
    return [each.name for each in bpy.context.preferences.filepaths.asset_libraries]


def test_the_asset_browser_shows_them():
    driver.clear_scene()
    yield from driver.wait_for(lambda: "Sparse Surface" in listed(), 10.0, "asset library")
    area = driver.viewport()
    area.ui_type = "ASSETS"
    yield 0.5
    area.spaces.active.params.asset_library_reference = "Sparse Surface"
    yield 2.0
    shown = next(each for each in area.regions if each.type == "WINDOW")
    with bpy.context.temp_override(window=driver.window(), area=area, region=shown):
        bpy.ops.file.select_all(action="SELECT")
    yield 0.5
    with bpy.context.temp_override(window=driver.window(), area=area, region=shown):
        found = {each.name for each in bpy.context.selected_assets}
    driver.shot("asset_browser")
    area.ui_type = "VIEW_3D"
    yield 0.3
    assert found == {"Heat Map", "Error Colours"}


def test_the_material_is_seen_in_material_preview_and_eevee():
    driver.clear_scene()
    driver.add_creased_grid(24)
    settings = bpy.context.scene.sparse_surface
    settings.iterations, settings.sweeps = 3, 0
    assert driver.approximate() == {"RUNNING_MODAL"}
    yield from driver.wait_for(lambda: driver.running() is None, 240.0, "result")
    with driver.in_viewport():
        bpy.ops.view3d.view_selected()
        assert bpy.ops.sparse_surface.use_heat_map_material("INVOKE_DEFAULT", True) == {"FINISHED"}
    shading = driver.viewport().spaces.active.shading
    yield 1.0
    grey = driver.coloured_pixels("solid")
    for kind in ("MATERIAL", "RENDERED"):
        shading.type = kind
        coloured, end = 0, time.monotonic() + 150.0  # the first time shaders are compiled
        while coloured < grey + 5000 and time.monotonic() < end:
            yield 3.0
            coloured = driver.coloured_pixels(f"shading_{kind.lower()}")
        assert coloured > grey + 5000, (kind, grey, coloured)
    shading.type = "SOLID"
    yield 0.3


if __name__ == "__main__":
    driver.run(*(value for name, value in list(globals().items()) if name.startswith("test_")))

"""Looking at patches and comparing methods in a window: panels, stepping, undo, a comparison in the background."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy
from mathutils import Vector

sys.path.insert(0, str(Path(__file__).parent))
import driver


def result(size: int = 24, **settings: Any) -> Any:
    driver.clear_scene()
    driver.add_creased_grid(size)
    for name, value in {"ring": 5, "iterations": 6, "sweeps": 0, "workers": 1, **settings}.items():
        setattr(bpy.context.scene.sparse_surface, name, value)
    with driver.in_viewport():
        bpy.ops.sparse_surface.approximate("EXEC_DEFAULT", True)
    return bpy.context.view_layer.objects.active


def shown() -> list[str]:
    return sorted(o.name for o in bpy.data.objects if "sparse_surface_inspected" in o)


def only_open(*names: str) -> Any:
    """Open these sub-panels and close the others: a script cannot click on their headers."""
    for module in ("ui.panels", "ui.advanced_panel", "ui.result_panel", "ui.inspect_panel"):
        for panel in driver.module(module).CLASSES:
            if "_PT_" in panel.__name__ and hasattr(panel, "bl_parent_id"):
                bpy.utils.unregister_class(panel)
                panel.bl_options = set() if panel.__name__ in names else {"DEFAULT_CLOSED"}
                bpy.utils.register_class(panel)
    yield 0.3


def press(name: str, **arguments: Any) -> Any:
    """Press a button of the panel, with an undo step, and let Blender draw."""
    with driver.in_viewport():
        assert getattr(bpy.ops.sparse_surface, name)("INVOKE_DEFAULT", True, **arguments) == {"FINISHED"}
    yield 0.3


def undo(back: bool = True) -> Any:
    with driver.in_viewport():
        bpy.ops.ed.undo() if back else bpy.ops.ed.redo()
    yield 0.3


def look_from_above() -> Any:
    with driver.in_viewport():
        bpy.ops.view3d.view_axis(type="TOP")
        bpy.ops.view3d.view_all()
    yield 1.0


def seen(placed: Any) -> bool:
    """Whether all corners of an object's box lie in the viewport, left of the sidebar."""
    from bpy_extras.view3d_utils import location_3d_to_region_2d

    area, over = driver.viewport(), driver.region("WINDOW")
    view = area.spaces.active.region_3d
    places = [location_3d_to_region_2d(over, view, placed.matrix_world @ Vector(corner)) for corner in placed.bound_box]
    return all(at is not None and 0 <= at.x <= over.width and 0 <= at.y <= over.height for at in places)


def test_a_patch_is_laid_out_facing_the_user_and_framed():
    made = result(30)
    yield from driver.open_sidebar()
    over = driver.region("UI")
    driver.click(over.x + 60, over.y + over.height - 593)
    yield 0.5
    yield from press("inspect_patch")
    yield 1.0
    driver.shot("inspect_facing")
    towards = driver.viewport().spaces.active.region_3d.view_rotation.to_matrix().col[2]
    sheet = bpy.data.objects["Patch 0 Optimised Domain"]
    assert sheet.matrix_world.to_3x3().col[2].normalized().dot(towards) > 0.999
    assert all(seen(bpy.data.objects[name]) for name in shown())
    assert seen(made)
    for _ in range(6):
        driver.window().event_simulate(type="WHEELDOWNMOUSE", value="PRESS", x=over.x + 100, y=over.y + 200)
    yield 0.5
    driver.shot("inspect_panel")


def test_patches_step_and_undo():
    result()
    shading = driver.viewport().spaces.active.shading
    shading.type, shading.color_type = "SOLID", "VERTEX"
    yield from only_open("SPARSE_SURFACE_PT_representation", "SPARSE_SURFACE_PT_inspect")
    yield from driver.open_sidebar()
    yield from press("inspect_patch")
    yield from press("inspect_patch", which="NEXT")
    assert "Patch 1 Optimised Domain" in shown()
    yield from look_from_above()
    driver.shot("inspect")
    yield from undo()
    assert "Patch 0 Optimised Domain" in shown()
    assert bpy.context.scene.sparse_surface.inspection.patch == 0
    yield from undo(back=False)
    assert "Patch 1 Optimised Domain" in shown()
    yield from press("clear_inspection")
    assert not shown()
    yield from undo()
    assert "Patch 1 Optimised Domain" in shown()


def test_resampling_and_its_undo():
    made = result()
    # made compact in the background: undoing leads back to what was there when the step began
    yield from driver.wait_for(lambda: "sparse_surface_draft" not in made, 240.0, "compact form")
    with driver.in_viewport():
        bpy.ops.ed.undo_push(message="Made compact")
    name, stored = made.name, made["sparse_surface_representation"]
    yield from press("resample", splits=4)
    assert bpy.context.view_layer.objects.active.name == f"{name} Resampled"
    assert len(bpy.context.view_layer.objects.active.data.polygons) == 16 * 23 * 23
    yield from look_from_above()
    driver.shot("resampled")
    yield from undo()
    assert f"{name} Resampled" not in bpy.data.objects
    assert bpy.data.objects[name]["sparse_surface_representation"] == stored


def test_patch_colours_show():
    made = result()
    yield from press("show_patches")
    yield from look_from_above()
    driver.shot("patches")
    assert made.data.color_attributes.active_color.name == "patch_color"


def test_methods_are_compared_in_the_background():
    driver.clear_scene()
    driver.add_creased_grid(24)
    bpy.context.scene.sparse_surface.comparison.second = "PRESET_fast"
    for name, value in {"ring": 5, "method": "traditional", "workers": 1}.items():
        setattr(bpy.context.scene.sparse_surface, name, value)
    bpy.context.scene.sparse_surface.job = "MEASURE"
    yield from only_open("SPARSE_SURFACE_PT_compare")
    yield from driver.open_sidebar()
    with driver.in_viewport():
        assert bpy.ops.sparse_surface.compare_methods("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    yield from driver.wait_for(lambda: driver.running() is None, 240.0, "end of the comparison")
    yield 0.5
    made = [o.name for o in bpy.data.objects]
    assert made == ["Creased", "Creased Sparse Surface 1 Traditional", "Creased Sparse Surface 2 Fast"], made
    driver.shot("compare")
    assert driver.module("operators.heat_map.shown").shows_heat_map(driver.viewport().spaces.active)
    assert all(seen(bpy.data.objects[name]) for name in made[1:])
    assert bpy.context.scene.sparse_surface.display.range_mode == "AUTOMATIC"


def test_a_cancelled_comparison_leaves_nothing_behind():
    driver.clear_scene()
    driver.add_creased_grid(60)
    with driver.in_viewport():
        assert bpy.ops.sparse_surface.compare_methods("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    yield from driver.wait_for(lambda: driver.running().progress, 60.0, "first word of the solver")
    driver.press("ESC")
    yield from driver.wait_for(lambda: driver.running() is None, 20.0, "end after ESC")
    yield 0.5
    assert [o.name for o in bpy.data.objects] == ["Creased"]
    assert not driver.children()


if __name__ == "__main__":
    driver.run(*(value for name, value in list(globals().items()) if name.startswith("test_")))

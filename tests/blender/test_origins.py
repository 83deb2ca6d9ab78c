"""A result knows its source: pressing again solves that once more, and no two surfaces are seen in one place."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import scenes


def visible() -> list[str]:
    return sorted(o.name for o in bpy.context.view_layer.objects if o.visible_get())


def rendered() -> list[str]:
    return sorted(o.name for o in bpy.data.objects if not o.hide_render)


def press_again(chosen: Any, **settings: Any) -> Any:
    scenes.select(chosen)
    return scenes.approximate(**settings)


@pytest.mark.parametrize("with_modifier", [False, True])
def test_pressing_again_solves_the_source_and_replaces_the_result(with_modifier: bool):
    """Also with modifiers, which Blender does not apply to a hidden source."""
    source = scenes.creased_sheet(12)
    if with_modifier:
        source.modifiers.new("Array", "ARRAY").count = 2
    first = scenes.approximate(ring=4)
    expected, report = scenes.positions(first.data), first["sparse_surface"].to_dict()
    second = press_again(first)
    assert second == first
    assert [o.name for o in bpy.data.objects] == ["Sheet", "Sheet Sparse Surface"]
    assert np.array_equal(scenes.positions(second.data), expected)
    assert second["sparse_surface"].to_dict()["surface_error"] == report["surface_error"]
    assert len(second.data.vertices) == (288 if with_modifier else 144)


def test_a_renamed_source_and_result_belong_together():
    source = scenes.creased_sheet(12)
    made = scenes.approximate()
    source.name, made.name = "Door", "Wall"
    assert press_again(made) == made
    assert press_again(source) == made
    assert sorted(o.name for o in bpy.data.objects) == ["Door", "Wall"]


def test_a_copy_of_the_source_gets_a_result_of_its_own(tmp_path: Path):
    source = scenes.creased_sheet(12)
    first = scenes.approximate()
    copy = source.copy()
    copy.data = source.data.copy()
    bpy.context.scene.collection.objects.link(copy)
    copy.hide_set(False)
    copy.name = "Another"  # Blender numbers the objects of a file by their names
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "copies.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "copies.blend"))
    copy, first = bpy.data.objects["Another"], bpy.data.objects["Sheet Sparse Surface"]
    second = press_again(copy)
    assert second != first
    assert (second.name, first.name) == ("Another Sparse Surface", "Sheet Sparse Surface")
    assert press_again(first) == first
    assert press_again(second) == second


def test_names_with_the_same_beginning_keep_both_results():
    sheets = [scenes.creased_sheet(8, "A" * 50 + end) for end in "xy"]
    for sheet in sheets:
        sheet.location.x += 3.0 * sheets.index(sheet)
    scenes.select(*sheets)
    scenes.approximate()
    first = sorted(o.name for o in bpy.context.selected_objects)
    assert len(first) == 2
    scenes.approximate()
    assert sorted(o.name for o in bpy.context.selected_objects) == first


def test_source_and_result_selected_together_are_solved_once():
    source = scenes.creased_sheet(12)
    made = scenes.approximate(source_shown="SHOWN")
    scenes.select(source, made)
    assert scenes.approximate() == made
    assert len(bpy.data.objects) == 2


def test_a_source_that_is_gone_is_said_with_the_way_on():
    source = scenes.creased_sheet(12)
    made = scenes.approximate()
    bpy.data.objects.remove(source)
    scenes.select(made)
    scenes.hurry()
    with pytest.raises(RuntimeError, match="made from is gone: press Use as Source"):
        bpy.ops.sparse_surface.approximate()
    other = scenes.creased_sheet(8, "Other")
    scenes.select(made, other)
    assert bpy.ops.sparse_surface.approximate() == {"FINISHED"}  # the other one, with a warning
    scenes.select(made)
    assert bpy.ops.sparse_surface.use_as_source() == {"FINISHED"}
    assert scenes.approximate().name == "Sheet Sparse Surface Sparse Surface"
    assert not bpy.ops.sparse_surface.use_as_source.poll() or bpy.context.object["sparse_surface_source"]


def test_only_the_result_is_seen_and_rendered_until_the_source_is_asked_for():
    source = scenes.creased_sheet(12)
    made = scenes.approximate()
    assert visible() == rendered() == [made.name]
    show = bpy.ops.sparse_surface.show_source
    assert show() == {"FINISHED"}
    assert visible() == rendered() == sorted([source.name, made.name])
    assert bpy.context.selected_objects == [made]
    assert show() == {"FINISHED"}
    assert visible() == rendered() == [made.name]
    assert show(beside=True) == {"FINISHED"}
    bpy.context.view_layer.update()
    assert scenes.world_positions(source)[:, 0].max() < scenes.world_positions(made)[:, 0].min()
    assert show() == {"FINISHED"}
    bpy.context.view_layer.update()
    assert made.matrix_world.translation == source.matrix_world.translation


def test_a_source_that_renders_left_out_stays_left_out():
    source = scenes.creased_sheet(12)
    source.hide_render = True
    scenes.approximate()
    bpy.ops.sparse_surface.show_source()
    assert source.hide_render
    assert source.visible_get()


def test_side_by_side():
    source = scenes.creased_sheet(12)
    source.rotation_euler = (0.2, 0.3, 0.9)
    for made in (scenes.approximate(source_shown="BESIDE"), press_again(source)):
        here, there = scenes.world_positions(source), scenes.world_positions(made)
        assert here[:, 0].max() < there[:, 0].min() < here[:, 0].max() + 0.5 * np.ptp(here[:, 0])
        assert np.allclose(here[:, 1:].mean(axis=0), there[:, 1:].mean(axis=0), atol=0.05)
        assert visible() == rendered() == sorted([source.name, made.name])


def test_on_request_all_stay_visible():
    source = scenes.creased_sheet(12)
    made = scenes.approximate(source_shown="SHOWN")
    assert visible() == rendered() == sorted([source.name, made.name])


def test_finer_meshes_and_separate_patches_take_the_place_of_their_result():
    scenes.creased_sheet(12)
    made = scenes.approximate(ring=4)
    assert bpy.ops.sparse_surface.resample(splits=2) == {"FINISHED"}
    fine = bpy.context.object
    assert visible() == rendered() == [fine.name]
    assert bpy.ops.sparse_surface.resample(splits=3) == {"FINISHED"}
    assert bpy.context.object == fine
    assert len(fine.data.polygons) == 9 * 11 * 11
    assert len(bpy.data.objects) == 3
    assert press_again(fine) == made
    assert visible() == rendered() == [made.name]
    for _ in range(2):
        scenes.select(made)
        assert bpy.ops.sparse_surface.separate_patches() == {"FINISHED"}
        patches = [o.name for o in bpy.data.objects if " Patch " in o.name]
        assert len(patches) == made["sparse_surface"]["patches"]
        assert visible() == rendered() == sorted(patches)
    assert [c.name for c in bpy.data.collections] == [f"{made.name} Patches"]
    assert press_again(made) == made
    assert visible() == rendered() == [made.name]


def test_linked_sources_are_found_by_library_and_name(tmp_path: Path):
    scenes.creased_sheet(12)
    path = str(tmp_path / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (_, here):
        here.objects = ["Sheet"]
    linked = here.objects[0]
    bpy.context.scene.collection.objects.link(linked)
    scenes.select(linked)
    made = scenes.approximate()
    assert visible() == [made.name]
    assert press_again(made) == made
    assert len(bpy.data.objects) == 2


@pytest.mark.parametrize("both", [False, True])
def test_a_result_is_compared_with_its_source_as_modifiers_leave_it(both: bool):
    """Hidden, or selected together with it and active; the result gets the colours either way."""
    source = scenes.creased_sheet(12)
    source.modifiers.new("Array", "ARRAY").count = 2
    made = scenes.approximate(source_shown="SHOWN" if both else "HIDDEN")
    expected = scenes.values(made.data, "error").copy()
    made.data.attributes.remove(made.data.attributes["error"])
    scenes.select(*([made, source] if both else [made]))
    assert bpy.ops.sparse_surface.compare() == {"FINISHED"}
    assert np.allclose(scenes.values(made.data, "error"), expected, rtol=1e-4, atol=1e-6)
    assert source.hide_get() != both
    assert "error" not in source.data.attributes

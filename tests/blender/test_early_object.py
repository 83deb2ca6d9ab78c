"""The result object while its surface is being solved: what is in it, and that it comes back from nowhere."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import scenes
from bl_ext.user_default.sparse_surface.operators.data.colours import ColourScale
from bl_ext.user_default.sparse_surface.operators.data.meshes import Source, read_object
from bl_ext.user_default.sparse_surface.operators.preview import object as early_object

SCALE = ColourScale(0.0, 0.5)


def show(sheet: bpy.types.Object, offset: float) -> Source:
    """Show a sheet's surface moved up by so much of the world's length."""
    source = read_object(sheet, bpy.context.evaluated_depsgraph_get())
    positions = source.arrays.vertices.astype(np.float64)
    positions[:, 2] += offset
    error = np.full(len(positions), offset)
    early_object.show(source, positions, error, SCALE, bpy.context)
    return source


def early_objects() -> list[bpy.types.Object]:
    return [each for each in bpy.data.objects if early_object.EARLY in each]


def test_it_looks_like_the_result_and_is_made_once() -> None:
    sheet = scenes.creased_sheet(8)
    sheet.location.x, sheet.scale = 2.0, (1.0, 1.0, 4.0)
    bpy.context.view_layer.update()
    source = show(sheet, 0.25)
    [early] = early_objects()
    assert early.name == f"{sheet.name} Sparse Surface"
    assert early == early_object.find(source.session_uid)
    assert early.hide_select
    assert early.hide_render
    assert set(early.users_collection) == set(sheet.users_collection)
    bpy.context.view_layer.update()
    assert early.matrix_world == sheet.matrix_world
    moved = scenes.world_positions(early) - scenes.world_positions(sheet)
    np.testing.assert_allclose(moved, np.tile([0.0, 0.0, 0.25], (len(moved), 1)), atol=1e-6)
    np.testing.assert_allclose(scenes.values(early.data, "error"), 0.25)
    show(sheet, 0.125)
    assert early_objects() == [early]
    np.testing.assert_allclose(scenes.values(early.data, "error"), 0.125)


def test_removing_leaves_no_mesh_and_no_other_object() -> None:
    sheets = [scenes.creased_sheet(6), scenes.creased_sheet(7)]
    meshes = len(bpy.data.meshes)
    for sheet in sheets:
        show(sheet, 0.1)
    assert len(early_objects()) == 2
    early_object.remove_all()
    assert not early_objects()
    assert len(bpy.data.meshes) == meshes
    assert all(sheet.name in bpy.data.objects for sheet in sheets)


def test_none_is_made_of_a_source_that_was_edited_or_deleted() -> None:
    sheet = scenes.creased_sheet(6)
    source = read_object(sheet, bpy.context.evaluated_depsgraph_get())
    positions, error = source.arrays.vertices.astype(np.float64), np.zeros(len(source.arrays.vertices))
    meshes = len(bpy.data.meshes)
    sheet.data.vertices.add(1)
    sheet.data.update()
    early_object.show(source, positions, error, SCALE, bpy.context)
    assert not early_objects()
    assert len(bpy.data.meshes) == meshes
    bpy.data.objects.remove(sheet)
    early_object.show(source, positions, error, SCALE, bpy.context)
    assert not early_objects()


def test_it_is_in_no_saved_file(tmp_path: Path) -> None:
    sheet = scenes.creased_sheet(6)
    show(sheet, 0.1)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"), copy=True)
    with bpy.data.libraries.load(str(tmp_path / "saved.blend")) as (saved, _):
        assert sheet.name in saved.objects
        assert f"{sheet.name} Sparse Surface" not in saved.objects


def test_what_a_crash_left_of_it_is_removed_on_loading(tmp_path: Path) -> None:
    sheet = scenes.creased_sheet(6)
    show(sheet, 0.1)
    name = sheet.name
    bpy.data.libraries.write(str(tmp_path / "left.blend"), {bpy.context.scene}, fake_user=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "left.blend"))
    assert name in bpy.data.objects
    assert not early_objects()


def test_undo_brings_it_back_only_during_a_run() -> None:
    sheet = scenes.creased_sheet(6)
    name = sheet.name
    bpy.ops.ed.undo_push(message="before")
    show(sheet, 0.1)
    bpy.ops.ed.undo_push(message="the user does something")
    early_object.remove_all()
    bpy.ops.ed.undo_push(message="the run has ended")
    early_object.begin()
    bpy.ops.ed.undo()
    assert len(early_objects()) == 1
    early_object.end()
    assert not early_objects()
    bpy.ops.ed.redo()
    bpy.ops.ed.undo()
    assert name in bpy.data.objects
    assert not early_objects()

"""Apply to Source: the source's own vertices move, everything else about it stays; what cannot be done is said."""

from __future__ import annotations

import sys
from math import radians
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import scenes

apply_to_source = bpy.ops.sparse_surface.apply_to_source


def rough_sheet(size: int = 12) -> Any:
    """Return a sheet that no smooth surface goes through."""
    sheet = scenes.creased_sheet(size)
    moved = scenes.positions(sheet.data)
    moved[:, 2] += 0.02 * np.random.default_rng(3).standard_normal(len(moved))
    sheet.data.vertices.foreach_set("co", moved.ravel())
    sheet.data.update()
    return sheet


def bent_by_rig(sheet: Any) -> Any:
    """Bind a sheet to two bones, and turn one of them by 70 degrees."""
    bpy.ops.object.armature_add(enter_editmode=True, location=(-1.0, 0.0, 0.0))
    rig = bpy.context.object
    first = rig.data.edit_bones[0]
    first.tail = (1.0, 0.0, 0.0)
    second = rig.data.edit_bones.new("Second")
    second.head, second.tail, second.parent = (1.0, 0.0, 0.0), (2.0, 0.0, 0.0), first
    names = first.name, second.name
    bpy.ops.object.mode_set(mode="OBJECT")
    for name, sign in zip(names, (-1.0, 1.0), strict=True):
        group = sheet.vertex_groups.new(name=name)
        for vertex in sheet.data.vertices:
            group.add([vertex.index], min(max(0.5 + sign * vertex.co.x, 0.0), 1.0), "REPLACE")
    rig.pose.bones[names[1]].rotation_mode = "XYZ"
    rig.pose.bones[names[1]].rotation_euler = (0.0, 0.0, radians(70.0))
    modifier = sheet.modifiers.new("Rig", "ARMATURE")
    modifier.object = rig
    scenes.select(sheet)
    return rig


def shaped(placed: Any) -> Any:
    """Return local positions after modifiers and shape keys."""
    bpy.context.view_layer.update()
    return scenes.positions(placed.evaluated_get(bpy.context.evaluated_depsgraph_get()).data).astype(float)


def test_a_plain_source_gets_the_surface_and_keeps_the_rest():
    sheet = rough_sheet()
    sheet.data.uv_layers.new(name="Own")
    mesh, before = sheet.data, scenes.positions(sheet.data)
    made = scenes.approximate(ring=4)
    wanted = scenes.positions(made.data)
    assert np.abs(wanted - before).max() > 1e-3
    assert apply_to_source() == {"FINISHED"}
    assert bpy.context.object == sheet
    assert sheet.data == mesh
    assert np.array_equal(scenes.positions(mesh), wanted)
    assert [layer.name for layer in mesh.uv_layers] == ["Own"]
    assert sheet.visible_get()
    assert not made.visible_get()
    assert not sheet.hide_render


def test_a_result_beside_its_source_comes_back_into_its_place():
    sheet = rough_sheet()
    sheet.location = (1.0, 2.0, 3.0)
    made = scenes.approximate(ring=4, source_shown="BESIDE")
    wanted = scenes.positions(made.data)
    assert apply_to_source() == {"FINISHED"}
    assert np.array_equal(scenes.positions(sheet.data), wanted)
    bpy.context.view_layer.update()
    assert tuple(made.matrix_world.translation) == pytest.approx((1.0, 2.0, 3.0), abs=1e-6)


def test_a_posed_rig_stays_and_the_posed_surface_is_the_result():
    sheet = rough_sheet()
    rig = bent_by_rig(sheet)
    made = scenes.approximate(ring=4)
    wanted, before = scenes.positions(made.data).astype(float), scenes.positions(sheet.data)
    assert np.abs(wanted - before).max() > 0.2  # posed
    assert apply_to_source() == {"FINISHED"}
    assert [modifier.name for modifier in sheet.modifiers] == ["Rig"]
    assert np.abs(shaped(sheet) - wanted).max() < 1e-5
    rig.pose.bones["Second"].rotation_euler = (0.0, 0.0, 0.0)
    assert 1e-3 < np.abs(shaped(sheet) - before).max() < 0.2


def test_shape_keys_stay_and_still_add_what_they_did():
    sheet = rough_sheet()
    sheet.shape_key_add(name="Basis")
    bump = sheet.shape_key_add(name="Bump")
    bump.data[40].co.z += 0.5
    bump.value = 0.5
    made = scenes.approximate(ring=4)
    wanted = scenes.positions(made.data).astype(float)
    with_key = shaped(sheet)
    bump.value = 0.0
    added = with_key - shaped(sheet)
    bump.value = 0.5
    assert apply_to_source() == {"FINISHED"}
    assert [key.name for key in sheet.data.shape_keys.key_blocks] == ["Basis", "Bump"]
    assert np.abs(shaped(sheet) - wanted).max() < 1e-6
    bump.value = 0.0
    assert np.abs((wanted - shaped(sheet)) - added).max() < 1e-6


@pytest.mark.parametrize("kind", ["SMOOTH", "SIMPLE_DEFORM", "DISPLACE"])
def test_modifiers_that_move_vertices_are_led_to_the_result_or_refused(kind: str):
    """Nothing lies further from the result than before, and what is left is what the operator says."""
    sheet = rough_sheet()
    modifier = sheet.modifiers.new("Deform", kind)
    if kind == "SIMPLE_DEFORM":
        modifier.deform_method, modifier.angle = "TWIST", radians(60.0)
    before = shaped(sheet)
    made = scenes.approximate(ring=4)
    wanted = scenes.positions(made.data).astype(float)
    assert apply_to_source() == {"FINISHED"}
    left = np.linalg.norm(shaped(sheet) - wanted, axis=1).max()
    assert left < 0.5 * np.linalg.norm(before - wanted, axis=1).max()
    if kind == "SIMPLE_DEFORM":
        assert left < 1e-5


def test_modifiers_that_change_the_vertices_are_refused_and_nothing_changes():
    sheet = rough_sheet()
    sheet.modifiers.new("Mirror", "MIRROR")
    before = scenes.positions(sheet.data)
    made = scenes.approximate(ring=4)
    with pytest.raises(RuntimeError, match=r"modifiers of 'Sheet' change its vertices: 144 of its own became \d+"):
        apply_to_source()
    assert np.array_equal(scenes.positions(sheet.data), before)
    assert bpy.context.object == made
    assert not sheet.visible_get()


def test_without_modifiers_the_base_mesh_gets_the_surface():
    sheet = rough_sheet()
    sheet.modifiers.new("Mirror", "MIRROR")
    made = scenes.approximate(ring=4, use_modifiers=False)
    wanted = scenes.positions(made.data)
    assert apply_to_source() == {"FINISHED"}
    assert np.array_equal(scenes.positions(sheet.data), wanted)
    assert [modifier.name for modifier in sheet.modifiers] == ["Mirror"]


def test_an_edited_source_and_a_finer_result_are_refused():
    sheet = rough_sheet()
    made = scenes.approximate(ring=4)
    scenes.select(made)
    assert bpy.ops.sparse_surface.resample() == {"FINISHED"}
    with pytest.raises(RuntimeError, match="have to be the same"):
        apply_to_source()
    scenes.select(made)
    sheet.data.flip_normals()
    with pytest.raises(RuntimeError, match="was edited since"):
        apply_to_source()


def test_one_undo_step_brings_the_old_vertices_back():
    sheet = rough_sheet()
    before = scenes.positions(sheet.data)
    made = scenes.approximate(ring=4)
    name, other = sheet.name, made.name
    bpy.ops.ed.undo_push(message="approximated")
    apply_to_source()
    bpy.ops.ed.undo_push(message="applied")
    assert not np.array_equal(scenes.positions(bpy.data.objects[name].data), before)
    bpy.ops.ed.undo()
    assert np.array_equal(scenes.positions(bpy.data.objects[name].data), before)
    assert bpy.data.objects[other].visible_get()


def test_objects_that_share_the_mesh_are_named(capfd: pytest.CaptureFixture[str]):
    sheet = rough_sheet()
    twin = sheet.copy()
    bpy.context.scene.collection.objects.link(twin)
    scenes.approximate(ring=4)
    assert apply_to_source() == {"FINISHED"}
    assert "These have the same mesh and change, too: Sheet.001" in capfd.readouterr().out
    assert twin.data == sheet.data

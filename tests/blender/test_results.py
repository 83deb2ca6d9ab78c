"""Results as objects: only of a source that is still the one that was read, and in its place."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface.operators.data import attributes
from bl_ext.user_default.sparse_surface.operators.data.meshes import read_object
from bl_ext.user_default.sparse_surface.operators.data.results import copy_source
from bl_ext.user_default.sparse_surface.operators.heat_map import shown
from bl_ext.user_default.sparse_surface.solver.errors import InputError

sys.path.insert(0, str(Path(__file__).parent))
import scenes


def test_an_edit_that_keeps_the_counts_is_noticed() -> None:
    """Two quads of which one takes another diagonal partner: as many vertices, edges, corners and faces as before."""
    points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)]
    placed = scenes.mesh_object("Strip", points, [(0, 1, 4, 3), (1, 2, 5, 4)])
    source = read_object(placed, bpy.context.evaluated_depsgraph_get())
    made_from, copy = copy_source(source, bpy.context)
    assert made_from == placed
    bpy.data.meshes.remove(copy)
    meshes = len(bpy.data.meshes)
    placed.data.flip_normals()
    with pytest.raises(InputError, match="was edited"):
        copy_source(source, bpy.context)
    assert len(bpy.data.meshes) == meshes


def test_a_result_hangs_on_the_bone_of_its_source() -> None:
    armature = bpy.data.objects.new("Armature", bpy.data.armatures.new("Armature"))
    bpy.context.scene.collection.objects.link(armature)
    scenes.select(armature)
    bpy.ops.object.mode_set(mode="EDIT")
    for name, height in (("Lower", 0.0), ("Upper", 1.0)):
        bone = armature.data.edit_bones.new(name)
        bone.head, bone.tail = (0, 0, height), (0, 0.5, height + 1.0)
    bpy.ops.object.mode_set(mode="OBJECT")
    sheet = scenes.creased_sheet(12)
    sheet.parent, sheet.parent_type, sheet.parent_bone = armature, "BONE", "Upper"
    sheet.location = (0.5, 0.25, 1.0)
    bpy.context.view_layer.update()
    made = scenes.approximate()
    assert (made.parent, made.parent_type, made.parent_bone) == (armature, "BONE", "Upper")
    armature.pose.bones["Upper"].location = (0.0, 3.0, 0.0)
    bpy.context.view_layer.update()
    np.testing.assert_allclose(made.matrix_world, sheet.matrix_world, atol=1e-6)


def test_attributes_of_several_kinds_are_written_and_read_by_name() -> None:
    """All at once: up to Blender 5.0 a layer that was fetched before the next was created holds other values."""
    mesh = scenes.creased_sheet(4).data
    mesh.attributes.new("patch", "FLOAT", "CORNER")
    rng = np.random.default_rng(1)
    written = {
        "error": rng.random(16, dtype=np.float32),
        "error_color": rng.random((16, 4), dtype=np.float32),
        "patch": np.arange(16, dtype=np.int32),
        "domain_stretch": rng.random(9, dtype=np.float32),
    }
    attributes.write(mesh, written)
    for name, values in written.items():
        np.testing.assert_array_equal(attributes.read(mesh, name), values)
    assert mesh.attributes["patch (source)"].domain == "CORNER"
    assert mesh.color_attributes.active_color.name == "error_color"
    np.testing.assert_array_equal(scenes.values(mesh, "domain_stretch"), written["domain_stretch"])


def test_colours_of_the_source_stay_the_active_ones() -> None:
    source = scenes.creased_sheet(8)
    for name, kind, domain in (("Scan", "BYTE_COLOR", "CORNER"), ("Paint", "FLOAT_COLOR", "POINT")):
        source.data.color_attributes.new(name, kind, domain)
    source.data.color_attributes.active_color_index = source.data.color_attributes.find("Scan")
    source.data.color_attributes.render_color_index = source.data.color_attributes.find("Paint")
    result = scenes.approximate()
    colours = result.data.color_attributes
    assert "error_color" in colours
    assert colours.active_color.name == "Paint" == colours[colours.render_color_index].name
    made = bpy.ops.sparse_surface.resample(splits=2) and bpy.context.view_layer.objects.active
    assert made.data.color_attributes.active_color.name in {"Paint", "Scan"}
    shown.choose_colours(result, "error_color")
    assert colours.active_color.name == "error_color"
    assert colours[colours.render_color_index].name == "Paint"

"""Where nothing that is selected can be approximated, the panel says what to do, with the button for it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy
import pytest
from bl_ext.user_default.sparse_surface.operators.run.way_on import way_on

sys.path.insert(0, str(Path(__file__).parent))
import scenes


def added(add: Any, **arguments: Any) -> Any:
    add(**arguments)
    return bpy.context.object


@pytest.mark.parametrize("kind", ["curve", "text", "surface", "metaball"])
def test_what_can_be_converted_is_converted_by_the_button_and_then_approximated(kind: str):
    add = {
        "curve": bpy.ops.curve.primitive_bezier_circle_add,
        "text": bpy.ops.object.text_add,
        "surface": bpy.ops.surface.primitive_nurbs_surface_sphere_add,
        "metaball": bpy.ops.object.metaball_add,
    }[kind]
    chosen = added(add)
    if kind == "curve":
        chosen.data.extrude = 0.5
    scenes.hurry()
    with pytest.raises(RuntimeError, match="convert it first"):
        bpy.ops.sparse_surface.approximate()
    way = way_on(bpy.context)
    assert way is not None
    assert (way.operator, way.properties) == ("object.convert", {"target": "MESH"})
    assert bpy.ops.object.convert(**way.properties) == {"FINISHED"}
    assert way_on(bpy.context) is None
    assert bpy.ops.sparse_surface.approximate.poll()


@pytest.mark.parametrize(
    "as_cloud",
    [
        False,
        pytest.param(
            True,
            marks=pytest.mark.skipif(bpy.app.version < (4, 3), reason="this Blender makes no point cloud objects"),
        ),
    ],
)
def test_points_lead_to_reconstruct(as_cloud: bool):
    scenes.mesh_object("Scan", [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [])
    if as_cloud:
        bpy.ops.object.convert(target="POINTCLOUD")
    with pytest.raises(RuntimeError, match="use Reconstruct"):
        bpy.ops.sparse_surface.approximate()
    way = way_on(bpy.context)
    assert way is not None
    assert way.operator == "sparse_surface.reconstruct"
    assert bpy.ops.sparse_surface.reconstruct.poll()


def test_edit_mode_hidden_objects_and_lost_sources():
    sheet = scenes.creased_sheet(8)
    assert way_on(bpy.context) is None
    bpy.ops.object.mode_set(mode="EDIT")
    assert way_on(bpy.context).operator == "object.mode_set"
    bpy.ops.object.mode_set(mode="OBJECT")
    sheet.hide_set(True)
    assert way_on(bpy.context).operator == "object.hide_view_clear"
    sheet.hide_set(False)
    scenes.select(sheet)
    scenes.approximate()
    bpy.data.objects.remove(sheet)
    assert way_on(bpy.context).operator == "sparse_surface.use_as_source"
    assert bpy.ops.sparse_surface.use_as_source() == {"FINISHED"}
    assert way_on(bpy.context) is None


def test_nothing_is_said_where_there_is_nothing_to_do():
    scenes.select()
    assert way_on(bpy.context) is None
    added(bpy.ops.object.light_add)
    assert way_on(bpy.context) is None

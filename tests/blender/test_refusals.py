"""What cannot be done is said in one sentence, and nothing is made."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface.operators.data.objects import selected_meshes
from bl_ext.user_default.sparse_surface.operators.run.poll import MESHES_TO_SOLVE, reason_against

sys.path.insert(0, str(Path(__file__).parent))
import scenes


def refusal() -> str:
    """Run the operator, check that it made nothing, and return what it said."""
    before = {name: len(getattr(bpy.data, name)) for name in ("objects", "meshes", "collections")}
    with pytest.raises(RuntimeError) as caught:
        bpy.ops.sparse_surface.approximate()
    assert before == {name: len(getattr(bpy.data, name)) for name in before}
    text = str(caught.value).strip()
    assert text.count("\n") == 0, text
    assert "Traceback" not in text
    return text


def test_nothing_selected():
    assert reason_against(bpy.context, *MESHES_TO_SOLVE) == "Select a mesh"
    assert "poll() Select a mesh" in refusal()


def test_not_a_mesh():
    light = bpy.data.objects.new("Light", bpy.data.lights.new("Light", "POINT"))
    bpy.context.scene.collection.objects.link(light)
    scenes.select(light)
    assert "not a mesh" in refusal()


def test_no_vertices():
    scenes.mesh_object("Nothing", [], [])
    assert "no faces" in refusal()


def test_no_faces():
    scenes.mesh_object("Points", np.eye(3), [])
    assert "no faces" in refusal()


def test_no_faces_after_modifiers():
    sheet = scenes.creased_sheet(8)
    sheet.vertex_groups.new(name="None")
    mask = sheet.modifiers.new("Mask", "MASK")
    mask.vertex_group = "None"
    assert "no " in refusal()


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_position_that_is_no_number(value):
    sheet = scenes.creased_sheet(8)
    positions = scenes.positions(sheet.data)
    positions[5, 1] = value  # a plain assignment would be clamped to the largest number
    sheet.data.vertices.foreach_set("co", positions.ravel())
    sheet.data.update()
    assert "finite" in refusal()


def test_no_area():
    scenes.mesh_object("Flat", [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)], [(0, 1, 2), (1, 2, 3)])
    assert "area" in refusal()


def test_outside_of_object_mode():
    scenes.creased_sheet(8)
    bpy.ops.object.mode_set(mode="EDIT")
    assert "Object Mode" in refusal()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert reason_against(bpy.context, *MESHES_TO_SOLVE) == ""


def hide_in_view_layer(placed):
    placed.hide_set(True)


def hide_in_viewports(placed):
    placed.hide_viewport = True


@pytest.mark.parametrize("hide", [hide_in_view_layer, hide_in_viewports])
def test_hidden_objects_are_left_alone_and_alone_they_are_refused(hide):
    shown, hidden = scenes.creased_sheet(8, "Shown"), scenes.creased_sheet(8, "Hidden")
    scenes.select(shown, hidden)
    hide(hidden)
    bpy.context.view_layer.update()
    assert selected_meshes(bpy.context) == [shown]
    shown.select_set(False)
    assert "'Hidden' is hidden" in refusal()
    bpy.context.view_layer.objects.active = shown
    assert reason_against(bpy.context, *MESHES_TO_SOLVE) == "Select a mesh"


def test_a_missing_package_is_named(run_bpy):
    """Without SciPy the extension registers, and the button says what is missing and what to do."""
    done = run_bpy(
        f"""
import sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("scipy", "sklearn"):
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Missing())
import importlib.util
plain = importlib.util.find_spec
importlib.util.find_spec = lambda name, *rest: None if name in ("scipy", "sklearn") else plain(name, *rest)
import bpy
import scenes
scenes.enable_extension()
bpy.ops.mesh.primitive_torus_add()
try:
    bpy.ops.sparse_surface.approximate()
except RuntimeError as error:
    print("said:", error)
"""
    )
    assert "SciPy is missing: install" in done.stdout, done.stdout + done.stderr

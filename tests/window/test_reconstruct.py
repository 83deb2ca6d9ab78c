"""Points to a surface in a window: progress, one undo step, and nothing left where it is cancelled."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import driver

MADE = {"Scan", "Scan Point Errors", "Scan Sparse Surface"}


def start(count: int = 1500) -> driver.Steps:
    """Begin on the points of a sphere, without a base."""
    driver.clear_scene()
    points = np.random.default_rng(0).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    mesh = bpy.data.meshes.new("Scan")
    mesh.from_pydata(points.tolist(), [], [])
    scan = bpy.data.objects.new("Scan", mesh)
    bpy.context.scene.collection.objects.link(scan)
    driver.select(scan)
    with driver.in_viewport():
        bpy.ops.ed.undo_push(message="Add Scan")
    yield 0.3
    with driver.in_viewport():
        assert bpy.ops.sparse_surface.reconstruct("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    yield from driver.wait_for(lambda: driver.running().progress, 60.0, "first word of the solver")


def test_it_runs_beside_the_user_and_makes_the_surface():
    yield from start()
    yield from driver.open_sidebar()
    assert {each.name for each in bpy.data.objects} == {"Scan"}
    yield from driver.wait_for(lambda: driver.running() is None, 240.0, "result")
    yield 0.5
    assert {each.name for each in bpy.data.objects} == MADE
    made = bpy.context.view_layer.objects.active
    assert made.name == "Scan Sparse Surface"
    assert made["sparse_surface"]["input"]["points"] == 1500
    driver.shot("reconstruction_done")
    yield from driver.wait_for(lambda: not driver.children(), 2.0, "end of the child")


def test_the_points_are_seen_in_their_colours_on_request():
    """Before, only the surface is seen."""
    assert {o.name for o in bpy.context.view_layer.objects if o.visible_get()} == {"Scan Sparse Surface"}
    with driver.in_viewport():
        assert bpy.ops.sparse_surface.show_point_errors("INVOKE_DEFAULT") == {"FINISHED"}
        bpy.ops.view3d.view_selected()
        bpy.ops.sparse_surface.show_heat_map("INVOKE_DEFAULT")
    yield 1.0
    driver.shot("point_errors")
    assert bpy.data.objects["Scan Point Errors"].visible_get()
    with driver.in_viewport():
        bpy.ops.sparse_surface.show_heat_map("INVOKE_DEFAULT")
        bpy.ops.sparse_surface.show_point_errors("INVOKE_DEFAULT")
    yield 0.3


def test_one_undo_step_takes_all_of_it_back():
    with driver.in_viewport():
        bpy.ops.ed.undo()
    yield 0.3
    assert {each.name for each in bpy.data.objects} == {"Scan"}
    with driver.in_viewport():
        bpy.ops.ed.redo()
    yield 0.3
    assert {each.name for each in bpy.data.objects} == MADE


def test_escape_leaves_nothing_behind():
    yield from start(6000)
    driver.press("ESC")
    yield from driver.wait_for(lambda: driver.running() is None, 1.0, "end after ESC")
    yield from driver.wait_for(lambda: not driver.children(), 2.0, "end of the child")
    yield 0.3
    assert {each.name for each in bpy.data.objects} == {"Scan"}
    assert len(bpy.data.meshes) == 1
    assert len(bpy.data.node_groups) == 0


driver.run(
    test_it_runs_beside_the_user_and_makes_the_surface,
    test_the_points_are_seen_in_their_colours_on_request,
    test_one_undo_step_takes_all_of_it_back,
    test_escape_leaves_nothing_behind,
)

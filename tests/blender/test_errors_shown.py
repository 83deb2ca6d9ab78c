"""Where errors are: selected above a tolerance, and points as bodies in their colours."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface.benchmarks.generated_clouds import ball

sys.path.insert(0, str(Path(__file__).parent))
import scenes


def test_vertices_above_the_tolerance_are_selected_and_no_others():
    scenes.creased_sheet(16)
    made = scenes.approximate(ring=4)
    error = scenes.values(made.data, "error").copy()
    limit = float(np.median(error))
    assert bpy.ops.sparse_surface.select_above(tolerance=limit) == {"FINISHED"}
    assert bpy.context.mode == "EDIT_MESH"
    made.update_from_editmode()
    chosen = np.array([vertex.select for vertex in made.data.vertices])
    assert np.array_equal(chosen, error > np.float32(limit))
    assert bpy.ops.sparse_surface.select_above(tolerance=2.0 * float(error.max())) == {"FINISHED"}
    made.update_from_editmode()
    assert not any(vertex.select for vertex in made.data.vertices)


@pytest.fixture
def surface() -> bpy.types.Object:
    scenes.mesh_object("Scan", ball(400).points, [])
    scenes.hurry().reconstruction.corrections = 1
    assert bpy.ops.sparse_surface.reconstruct() == {"FINISHED"}
    return bpy.context.object


def test_after_reconstructing_only_the_surface_is_seen(surface: bpy.types.Object):
    assert [each.name for each in bpy.data.objects if each.visible_get()] == [surface.name]


def test_points_become_small_bodies_in_their_colours(surface: bpy.types.Object):
    assert bpy.ops.sparse_surface.show_point_errors() == {"FINISHED"}
    points = bpy.data.objects["Scan Point Errors"]
    assert points.visible_get()
    assert len(points.data.vertices) == 400  # the points themselves, for scripts
    shaped = points.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert len(shaped.vertices) == 400 + 400 * 12  # the points, which carry the active colours, and the bodies' corners
    at = scenes.positions(points.data)
    assert np.array_equal(scenes.positions(shaped)[:400], at)
    colours = scenes.values(shaped, "error_color", "color", 4)[400:].reshape(400, 12, 4)
    assert np.allclose(colours, colours[:, :1])
    assert np.allclose(colours[:, 0], scenes.values(points.data, "error_color", "color", 4), atol=1e-6)
    bodies = scenes.positions(shaped)[400:].reshape(400, 12, 3)
    assert np.allclose(bodies.mean(axis=1), at, atol=1e-5)
    apart = np.linalg.norm(at[:, None] - at[None], axis=2) + 10.0 * np.eye(400)
    assert np.linalg.norm(bodies[:, 0] - at, axis=1).max() < np.median(apart.min(axis=1))
    assert bpy.ops.sparse_surface.show_point_errors() == {"FINISHED"}
    assert not points.visible_get()
    bpy.ops.sparse_surface.show_point_errors()
    assert len(points.modifiers) == 1
    assert len(bpy.data.node_groups) == 1


def test_a_mesh_has_no_point_errors():
    scenes.creased_sheet(12)
    scenes.approximate(ring=4)
    assert not bpy.ops.sparse_surface.show_point_errors.poll()

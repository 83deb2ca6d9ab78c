"""Meshes are read as Blender's own properties show them, in Edit Mode too, and written so that Blender shows it."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface.operators.data.meshes import (
    loose_edges,
    read_edges,
    read_mesh,
    read_object,
    set_positions,
    sharp_turns,
)

sys.path.insert(0, str(Path(__file__).parent))
import scenes


@pytest.fixture
def mixed():
    """A cube of quads with a triangle beside it, an edge without a face, and three edges marked as sharp."""
    corners = [[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)]
    more = [[3.0, 0.0, 0.0], [4.0, 0.0, 0.0], [3.0, 1.0, 0.5], [6.0, 0.0, 0.0], [7.0, 0.0, 0.0]]
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3], [8, 9, 10]]
    mesh = bpy.data.meshes.new("Mixed")
    mesh.from_pydata(corners + more, [[11, 12]], faces)
    made = bpy.data.objects.new("Mixed", mesh)
    bpy.context.scene.collection.objects.link(made)
    bpy.context.view_layer.objects.active = made
    for edge in (1, 4, 5):
        mesh.edges[edge].use_edge_sharp = True
    return made


def check(mesh):
    """Compare with Blender's properties, read one by one."""
    arrays = read_mesh(mesh)
    np.testing.assert_array_equal(arrays.vertices, [vertex.co[:] for vertex in mesh.vertices])
    np.testing.assert_array_equal(arrays.corners, [loop.vertex_index for loop in mesh.loops])
    np.testing.assert_array_equal(read_edges(mesh), [edge.vertices[:] for edge in mesh.edges])
    sharp = [edge.vertices[:] for edge in mesh.edges if edge.use_edge_sharp]
    np.testing.assert_array_equal(arrays.sharp_edges, sharp)
    assert len(sharp) == 3


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_a_mesh_is_read_as_blender_shows_it(mixed, mode):
    bpy.ops.object.mode_set(mode=mode)
    try:
        check(mixed.data)
        check(mixed.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh())
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")


def test_edges_without_faces_and_turns(mixed):
    np.testing.assert_array_equal(np.sort(loose_edges(mixed.data)), [[11, 12]])
    assert sharp_turns(mixed.data, 89.0) == 12
    assert sharp_turns(mixed.data, 91.0) == 0


def test_no_edge_is_sharp_unless_marked():
    sheet = scenes.creased_sheet(4).data
    assert read_mesh(sheet).sharp_edges is None
    sheet.edges[3].use_edge_sharp = True
    assert len(read_mesh(sheet).sharp_edges) == 1
    sheet.edges[3].use_edge_sharp = False
    assert read_mesh(sheet).sharp_edges is None


def random_quads():
    """Return a mesh and its faces: flat, bent, twisted, concave and folded quads, with triangles among them."""
    random = np.random.default_rng(3)
    points = random.normal(size=(4000, 3)) * [1.0, 1.0, 0.3]
    faces = [random.choice(4000, random.integers(3, 5), replace=False).tolist() for _ in range(3000)]
    mesh = bpy.data.meshes.new("Quads")
    mesh.from_pydata(points, [], faces)
    return mesh, faces


def check_triangles(arrays, mesh):
    """Compare with Blender's triangles, read one by one."""
    mesh.calc_loop_triangles()
    np.testing.assert_array_equal(arrays.triangles, [each.vertices[:] for each in mesh.loop_triangles])
    np.testing.assert_array_equal(arrays.triangle_polygons, [each.polygon_index for each in mesh.loop_triangles])
    assert arrays.triangle_count == len(mesh.loop_triangles)


def test_quads_are_cut_as_blender_cuts_them():
    mesh, faces = random_quads()
    arrays = read_mesh(mesh)
    assert arrays.triangulation is None  # the process that solves does it, while Blender's window goes on
    check_triangles(arrays, mesh)
    first = {polygon: triangle for triangle, polygon in reversed(list(enumerate(arrays.triangle_polygons)))}
    flipped = [arrays.triangles[first[k], 2] == face[3] for k, face in enumerate(faces) if len(face) == 4]
    assert 0.2 < np.mean(flipped) < 0.8  # both ways occur


def test_quads_of_a_scaled_object_are_cut_as_blender_cuts_them():
    """Blender does not know the scale there."""
    mesh, _ = random_quads()
    placed = bpy.data.objects.new("Quads", mesh)
    placed.scale = 1.0, 5.0, 0.2
    bpy.context.scene.collection.objects.link(placed)
    bpy.context.view_layer.update()
    arrays = read_object(placed, bpy.context.evaluated_depsgraph_get()).arrays
    check_triangles(arrays, mesh)
    assert (replace(arrays, triangulation=None).triangles != arrays.triangles).any()


def test_moved_vertices_turn_normals_and_boxes_with_them(mixed):
    mesh = mixed.data
    before = [polygon.normal.copy() for polygon in mesh.polygons]
    positions = read_mesh(mesh).vertices[:, [1, 2, 0]] * 2.0
    set_positions(mesh, positions)
    np.testing.assert_array_equal([vertex.co[:] for vertex in mesh.vertices], positions)
    for polygon, normal in zip(mesh.polygons, before, strict=True):
        np.testing.assert_allclose(polygon.normal, normal.yzx, atol=1e-6)
    bpy.context.view_layer.update()
    box = np.array(mixed.evaluated_get(bpy.context.evaluated_depsgraph_get()).bound_box)
    np.testing.assert_allclose(box.max(axis=0), positions.max(axis=0), atol=1e-6)

"""Every data layer of the source survives on the result."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import scenes


@pytest.fixture
def rich():
    """Return a sheet with one of everything, its polygons triangles, quads and a pentagon."""
    sheet = scenes.creased_sheet(12)
    mesh = sheet.data
    import bmesh

    edited = bmesh.new()
    edited.from_mesh(mesh)
    edited.faces.ensure_lookup_table()
    bmesh.ops.triangulate(edited, faces=edited.faces[:6])
    joined = next(edge for edge in edited.edges if sorted(len(f.verts) for f in edge.link_faces) == [3, 4])
    bmesh.utils.face_join(list(joined.link_faces))
    edited.to_mesh(mesh)
    edited.free()
    uv = mesh.uv_layers.new(name="Chart")
    uv.data.foreach_set("uv", np.random.default_rng(1).random(2 * len(mesh.loops)).astype(np.float32))
    for name in ("Red", "Blue"):
        mesh.materials.append(bpy.data.materials.new(name))
    mesh.polygons.foreach_set("material_index", np.arange(len(mesh.polygons), dtype=np.int32) % 2)
    mesh.polygons.foreach_set("use_smooth", np.arange(len(mesh.polygons)) % 2 == 0)
    group = sheet.vertex_groups.new(name="Group")
    group.add([0, 5, 9], 0.25, "REPLACE")
    seams = np.arange(len(mesh.edges)) % 3 == 0
    sharp = np.arange(len(mesh.edges)) % 5 == 0
    mesh.edges.foreach_set("use_seam", seams)
    mesh.edges.foreach_set("use_edge_sharp", sharp)
    for name, kind, domain in (("heat", "FLOAT", "POINT"), ("crease_edge", "FLOAT", "EDGE"), ("number", "INT", "FACE")):
        mesh.attributes.new(name, kind, domain)
    mesh.attributes["heat"].data.foreach_set("value", np.linspace(0, 1, len(mesh.vertices), dtype=np.float32))
    mesh.attributes["crease_edge"].data.foreach_set("value", np.linspace(0, 1, len(mesh.edges), dtype=np.float32))
    mesh.attributes["number"].data.foreach_set("value", np.arange(len(mesh.polygons), dtype=np.int32))
    mesh.color_attributes.new("Paint", "BYTE_COLOR", "CORNER")
    sheet["note"] = "mine"
    return sheet


def test_every_layer_survives(rich):
    source = rich.data
    made = scenes.approximate()
    mesh = made.data
    assert {len(p.vertices) for p in source.polygons} == {3, 4, 5}
    assert [list(p.vertices) for p in mesh.polygons] == [list(p.vertices) for p in source.polygons]
    assert [p.material_index for p in mesh.polygons] == [p.material_index for p in source.polygons]
    assert [p.use_smooth for p in mesh.polygons] == [p.use_smooth for p in source.polygons]
    assert [m.name for m in mesh.materials] == ["Red", "Blue"]
    assert [e.use_seam for e in mesh.edges] == [e.use_seam for e in source.edges]
    assert [e.use_edge_sharp for e in mesh.edges] == [e.use_edge_sharp for e in source.edges]
    assert [tuple(d.uv) for d in mesh.uv_layers["Chart"].data] == [tuple(d.uv) for d in source.uv_layers["Chart"].data]
    for name in ("heat", "crease_edge", "number"):
        assert np.array_equal(scenes.values(mesh, name), scenes.values(source, name))
    assert "Paint" in mesh.color_attributes
    assert [g.name for g in made.vertex_groups] == ["Group"]
    weights = {v.index: g.weight for v in mesh.vertices for g in v.groups}
    assert weights == {0: 0.25, 5: 0.25, 9: 0.25}


def test_custom_normals_follow_the_surface():
    sheet = scenes.creased_sheet(16)
    mesh = sheet.data
    mesh.polygons.foreach_set("use_smooth", np.ones(len(mesh.polygons), dtype=bool))
    tilted = np.array(
        [corner.normal for corner in mesh.corner_normals] if False else [(0.1, 0.0, 1.0)] * len(mesh.loops)
    )
    tilted /= np.linalg.norm(tilted, axis=1)[:, None]
    mesh.normals_split_custom_set(tilted.tolist())
    assert mesh.has_custom_normals
    before = np.array([tuple(c.vector) for c in mesh.corner_normals])
    made = scenes.approximate(iterations=8).data
    assert made.has_custom_normals
    after = np.array([tuple(c.vector) for c in made.corner_normals])
    angle = np.degrees(np.arccos(np.clip((before * after).sum(axis=1), -1.0, 1.0)))
    assert np.median(angle) < 3.0


def test_a_users_layer_of_the_same_name_is_kept_under_another():
    sheet = scenes.creased_sheet(12)
    mesh = sheet.data
    mesh.attributes.new("error", "FLOAT", "FACE")
    mesh.attributes["error"].data.foreach_set("value", np.full(len(mesh.polygons), 7.0, dtype=np.float32))
    mesh.uv_layers.new(name="patch")
    made = scenes.approximate().data
    assert (made.attributes["error"].data_type, made.attributes["error"].domain) == ("FLOAT", "POINT")
    assert np.all(scenes.values(made, "error (source)") == 7.0)
    assert made.attributes["patch"].data_type == "INT"
    assert "patch (source)" in made.uv_layers
    assert mesh.attributes["error"].domain == "FACE"


def test_a_vertex_group_gives_the_name_to_the_attribute():
    """Geometry nodes find a vertex group before an attribute of the same name."""
    sheet = scenes.creased_sheet(12)
    sheet.vertex_groups.new(name="patch").add([3], 0.5, "REPLACE")
    made = scenes.approximate()
    assert [group.name for group in made.vertex_groups] == ["patch (source)"]
    assert made.vertex_groups[0].weight(3) == 0.5
    assert [group.name for group in sheet.vertex_groups] == ["patch"]


def test_materials_of_the_object_survive():
    sheet = scenes.creased_sheet(12)
    sheet.data.materials.append(None)
    sheet.material_slots[0].link = "OBJECT"
    sheet.material_slots[0].material = bpy.data.materials.new("Of the object")
    made = scenes.approximate()
    assert [slot.material.name for slot in made.material_slots] == ["Of the object"]


def test_loose_vertices_edges_and_holes_stay():
    sheet = scenes.creased_sheet(16)
    mesh = sheet.data
    positions = [tuple(v.co) for v in mesh.vertices] + [(5, 5, 5), (6, 5, 5)]
    faces = [list(p.vertices) for p in mesh.polygons if p.index not in (100, 101)]
    loose = bpy.data.meshes.new("Loose")
    loose.from_pydata(positions, [(256, 257)], faces)
    sheet.data = loose
    made = scenes.approximate().data
    assert len(made.vertices) == 258
    assert len(made.edges) == len(loose.edges)
    assert np.array_equal(scenes.positions(made)[256:], [(5, 5, 5), (6, 5, 5)])
    assert np.all(scenes.values(made, "error")[256:] == 0.0)
    assert np.all(scenes.values(made, "patch")[256:] == -1)

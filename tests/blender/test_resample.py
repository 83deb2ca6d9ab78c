"""Resampling in Blender: the surface where it belongs, with every layer, from the representation in the .blend."""

from __future__ import annotations

import itertools
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface.operators.representation.stored import read_representation
from bl_ext.user_default.sparse_surface.solver.surface.resampling import resample
from mathutils import Euler, Matrix, Vector

sys.path.insert(0, str(Path(__file__).parent))
import scenes


def kept(result):
    """Return how far a compact representation may be from the surface that was found."""
    return 1.1e-5 * np.ptp(scenes.world_positions(result), axis=0).max()


def resampled(splits: int = 2):
    assert bpy.ops.sparse_surface.resample(splits=splits) == {"FINISHED"}
    return bpy.context.view_layer.objects.active


def edge_keys(mesh):
    return {tuple(sorted(edge.vertices)) for edge in mesh.edges}


def test_it_is_the_representations_surface():
    scenes.creased_sheet(12)
    result = scenes.approximate()
    made = resampled(3)
    expected = resample(read_representation(result), 3)
    assert made.name == "Sheet Sparse Surface Resampled" == made.data.name
    assert np.array_equal(scenes.positions(made.data), expected.vertices.astype(np.float32))
    assert [list(p.vertices) for p in made.data.polygons] == [list(map(int, f)) for f in expected.polygons()]
    assert {len(p.vertices) for p in made.data.polygons} == {4}
    assert len(made.data.polygons) == 9 * len(result.data.polygons)
    assert not made.data.validate()
    count = len(result.data.vertices)
    assert np.allclose(scenes.positions(made.data)[:count], scenes.positions(result.data), atol=kept(result))


def test_the_result_stays_as_it_is_and_only_the_new_object_is_selected():
    scenes.creased_sheet(12)
    result = scenes.approximate()
    before = scenes.positions(result.data).tobytes(), len(result.data.attributes), result["sparse_surface"].to_dict()
    made = resampled()
    assert made != result
    assert before == (
        scenes.positions(result.data).tobytes(), len(result.data.attributes), result["sparse_surface"].to_dict()
    )  # fmt: skip
    assert bpy.context.selected_objects == [made]


def test_errors_and_colours_are_those_of_the_new_points():
    source = scenes.creased_sheet(12)
    result = scenes.approximate()
    made = resampled(2)
    assert list(made["error_color_range"]) == list(result["error_color_range"])
    error = scenes.values(made.data, "error")
    count = len(source.data.vertices)
    assert np.allclose(error[:count], scenes.values(result.data, "error"), atol=6.0 * kept(result))
    middle = (scenes.positions(source.data)[0] + scenes.positions(source.data)[1]) / 2
    number = np.argmin(np.linalg.norm(scenes.positions(made.data) - middle, axis=1))
    expected = np.linalg.norm(scenes.positions(made.data)[number] - middle)
    assert error[number] == pytest.approx(expected, abs=6.0 * kept(result))
    assert made.data.color_attributes.active_color.name == "error_color"


def test_it_stands_where_the_result_stands():
    source = scenes.creased_sheet(12)
    source.matrix_world = Matrix.LocRotScale(Vector((3, -2, 5)), Euler((0.3, 0.8, -1.1)), Vector((2.0, 0.5, 1.5)))
    result = scenes.approximate()
    made = resampled(2)
    count = len(source.data.vertices)
    assert np.allclose(scenes.world_positions(made)[:count], scenes.world_positions(result), atol=kept(result))
    error = np.linalg.norm(scenes.world_positions(made)[:count] - scenes.world_positions(source), axis=1)
    assert np.allclose(scenes.values(made.data, "error")[:count], error, atol=6.0 * kept(result))


def test_applied_transforms_are_followed():
    source = scenes.creased_sheet(12)
    source.scale = (2.0, 3.0, 0.5)
    source.rotation_euler = (0.4, 0.2, 1.0)
    result = scenes.approximate()
    bpy.ops.object.transform_apply(location=True, rotation=True, scale=True)
    assert tuple(result.scale) == (1.0, 1.0, 1.0)
    made = resampled(2)
    count = len(source.data.vertices)
    assert np.allclose(scenes.world_positions(made)[:count], scenes.world_positions(result), atol=kept(result))


def test_an_edited_mesh_is_refused():
    scenes.creased_sheet(12)
    result = scenes.approximate()
    result.data.vertices[5].co.z += 0.5
    with pytest.raises(RuntimeError, match="was edited"):
        bpy.ops.sparse_surface.resample()
    import bmesh

    edited = bmesh.new()
    edited.from_mesh(result.data)
    edited.faces.ensure_lookup_table()
    bmesh.ops.delete(edited, geom=edited.faces[:3], context="FACES")
    edited.to_mesh(result.data)
    edited.free()
    with pytest.raises(RuntimeError, match="was edited"):
        bpy.ops.sparse_surface.resample()
    assert len(bpy.data.objects) == 2


@pytest.mark.parametrize("damage", [b"nonsense", b"", None])
def test_a_damaged_representation_is_refused(damage):
    scenes.creased_sheet(12)
    result = scenes.approximate()
    meshes = len(bpy.data.meshes)
    stored = result["sparse_surface_representation"]
    result["sparse_surface_representation"] = stored[: len(stored) // 2] if damage is None else damage
    with pytest.raises(RuntimeError, match="representation"):
        bpy.ops.sparse_surface.resample()
    assert len(bpy.data.meshes) == meshes


def test_only_results_can_be_resampled():
    source = scenes.creased_sheet(12)
    assert not bpy.ops.sparse_surface.resample.poll()
    result = scenes.approximate()
    assert bpy.ops.sparse_surface.resample.poll()
    bpy.ops.object.mode_set(mode="EDIT")
    assert not bpy.ops.sparse_surface.resample.poll()
    bpy.ops.object.mode_set(mode="OBJECT")
    scenes.select(source)
    assert not bpy.ops.sparse_surface.resample.poll()
    scenes.select(result)
    assert resampled() == resampled()  # a finer mesh is made again from its result


def test_every_layer_is_interpolated():
    sheet = scenes.creased_sheet(6)
    mesh = sheet.data
    flat = scenes.positions(mesh)
    corner = np.array([loop.vertex_index for loop in mesh.loops])
    face_of = np.repeat(np.arange(len(mesh.polygons)), 4)
    for name in ("First", "Chart"):
        uv = mesh.uv_layers.new(name=name)
        uv.data.foreach_set("uv", (flat[corner, :2] + 10.0 * face_of[:, None]).astype(np.float32).ravel())
    mesh.uv_layers.active = mesh.uv_layers["Chart"]
    mesh.uv_layers["First"].active_render = True
    for name in ("Red", "Blue"):
        mesh.materials.append(bpy.data.materials.new(name))
    mesh.polygons.foreach_set("material_index", np.arange(len(mesh.polygons), dtype=np.int32) % 2)
    mesh.polygons.foreach_set("use_smooth", np.arange(len(mesh.polygons)) % 3 == 0)
    mesh.edges.foreach_set("use_seam", np.arange(len(mesh.edges)) % 3 == 0)
    mesh.edges.foreach_set("use_edge_sharp", np.arange(len(mesh.edges)) % 5 == 0)
    kinds = (
        ("heat", "FLOAT", "POINT"), ("crease_edge", "FLOAT", "EDGE"), ("number", "INT", "FACE"),
        ("chosen", "BOOLEAN", "POINT"), ("direction", "FLOAT_VECTOR", "CORNER"), ("small", "INT8", "POINT"),
        ("paint", "BYTE_COLOR", "CORNER"), ("turn", "QUATERNION", "POINT"),
    )  # fmt: skip
    for name, kind, domain in kinds:
        mesh.attributes.new(name, kind, domain)
    mesh.attributes["heat"].data.foreach_set("value", flat[:, 0].astype(np.float32))
    mesh.attributes["crease_edge"].data.foreach_set("value", np.arange(1, len(mesh.edges) + 1, dtype=np.float32))
    mesh.attributes["number"].data.foreach_set("value", np.arange(len(mesh.polygons), dtype=np.int32))
    mesh.attributes["direction"].data.foreach_set("vector", flat[corner].astype(np.float32).ravel())
    group = sheet.vertex_groups.new(name="Empty")
    group = sheet.vertex_groups.new(name="Group")
    for vertex in range(len(mesh.vertices)):
        if flat[vertex, 0] > 0.0:
            group.add([vertex], float(flat[vertex, 0]), "REPLACE")
    result = scenes.approximate(ring=3)
    made = resampled(2).data
    expected = resample(read_representation(result), 2)
    flat_fine = expected.at_vertices.linear(flat.astype(float))
    fine_face = expected.source_face
    fine_corner = np.repeat(fine_face, expected.sizes)
    for name in ("First", "Chart"):
        uv = scenes.values(made, name, "vector", 2)
        assert np.allclose(uv, flat_fine[expected.corners, :2] + 10.0 * fine_corner[:, None], atol=1e-4)
    assert made.uv_layers.active.name == "Chart"
    assert made.uv_layers["First"].active_render
    assert not made.uv_layers["Chart"].active_render
    assert [material.name for material in made.materials] == ["Red", "Blue"]
    assert [p.material_index for p in made.polygons] == [int(face) % 2 for face in fine_face]
    assert [p.use_smooth for p in made.polygons] == [int(face) % 3 == 0 for face in fine_face]
    assert np.allclose(scenes.values(made, "heat"), flat_fine[:, 0], atol=1e-6)
    assert np.array_equal(scenes.values(made, "number"), fine_face)
    assert np.allclose(scenes.values(made, "direction", "vector", 3), flat_fine[expected.corners], atol=1e-6)
    layers = {name: (made.attributes[name].data_type, made.attributes[name].domain) for name, _, _ in kinds}
    assert layers == {name: (kind, domain) for name, kind, domain in kinds}
    number = {tuple(sorted(edge.vertices)): edge.index for edge in made.edges}
    old = {tuple(sorted(edge.vertices)): edge for edge in mesh.edges}
    on_edges = set()
    for pair, chain in zip(expected.edges.tolist(), expected.chains.tolist(), strict=True):
        edge = old[tuple(pair)]
        for a, b in itertools.pairwise(chain):
            new = made.edges[number[tuple(sorted((a, b)))]]
            on_edges.add(new.index)
            assert (new.use_seam, new.use_edge_sharp) == (edge.use_seam, edge.use_edge_sharp)
            assert made.attributes["crease_edge"].data[new.index].value == edge.index + 1
    inner = [edge for edge in made.edges if edge.index not in on_edges]
    assert inner
    assert not any(edge.use_seam or edge.use_edge_sharp for edge in inner)
    holder = bpy.context.object
    assert [g.name for g in holder.vertex_groups] == ["Empty", "Group"]
    for vertex in made.vertices:
        weight = max(0.0, sum(g.weight for g in vertex.groups))
        assert weight >= 0.0
    on_axis = [v for v in made.vertices if flat_fine[v.index, 0] > 0.5]
    for vertex in on_axis:
        assert vertex.groups[0].weight == pytest.approx(flat_fine[vertex.index, 0], abs=1e-5)


def test_loose_parts_stay():
    vertices = [(x, y, 0.2 * abs(x - y)) for x in range(5) for y in range(5)] + [(9, 9, 9), (8, 8, 8), (7, 7, 7)]
    faces = [[5 * i + j, 5 * i + j + 5, 5 * i + j + 6, 5 * i + j + 1] for i in range(4) for j in range(4)]
    mesh = bpy.data.meshes.new("Loose")
    mesh.from_pydata(vertices, [(25, 26), (3, 27)], faces)
    source = bpy.data.objects.new("Loose", mesh)
    bpy.context.scene.collection.objects.link(source)
    scenes.select(source)
    scenes.approximate(ring=2)
    made = resampled(3).data
    assert {(25, 26), (3, 27)} <= edge_keys(made)
    assert np.allclose(scenes.positions(made)[25:28], vertices[25:], atol=1e-6)
    assert sum(edge.is_loose for edge in made.edges) == 2


def test_it_is_there_after_saving_and_loading(tmp_path):
    scenes.creased_sheet(12)
    result = scenes.approximate()
    draft = result["sparse_surface_representation"]
    name, path = result.name, str(tmp_path / "kept.blend")
    before = scenes.positions(resampled(2).data)
    bpy.ops.wm.save_as_mainfile(filepath=path)
    stored = result["sparse_surface_representation"]
    assert len(stored) < 0.4 * len(draft), "what is saved is not compact"
    scenes.select(result)
    expected = scenes.positions(resampled(2).data).tobytes()
    assert np.allclose(np.frombuffer(expected, dtype=np.float32).reshape(-1, 3), before, atol=kept(result))
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=path)
    loaded = bpy.data.objects[name]
    assert loaded["sparse_surface_representation"] == stored
    scenes.select(loaded)
    assert scenes.positions(resampled(2).data).tobytes() == expected
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.append(directory=f"{path}/Object/", filename=name)
    appended = bpy.data.objects[name]
    scenes.select(appended)
    assert scenes.positions(resampled(2).data).tobytes() == expected


def test_a_replaced_result_has_the_new_one():
    source = scenes.creased_sheet(12)
    before = set()
    for ring in (4, 3, 5):
        scenes.select(source)
        result = scenes.approximate(ring=ring)
        stored = result["sparse_surface_representation"]
        assert stored not in before
        before.add(stored)
        made = resampled(1)
        assert np.allclose(scenes.positions(made.data), scenes.positions(result.data), atol=kept(result))


def test_duplicates_have_it_too():
    scenes.creased_sheet(12)
    scenes.approximate()
    bpy.ops.object.duplicate()
    copied = bpy.context.object
    copied.data.transform(Matrix.Scale(2.0, 4))
    made = resampled(1)
    assert np.allclose(scenes.positions(made.data), scenes.positions(copied.data), atol=kept(copied))


def test_the_density_has_its_limits():
    scenes.creased_sheet(8)
    scenes.approximate(ring=3)
    properties = bpy.ops.sparse_surface.resample.get_rna_type().properties
    assert (properties["splits"].hard_min, properties["splits"].default) == (1, 2)
    made = resampled(properties["splits"].hard_max)
    assert len(made.data.polygons) == 49 * properties["splits"].hard_max ** 2


def test_vertices_that_lie_at_one_place_are_one_on_the_finer_mesh():
    """A seam of doubled vertices, as importers leave where UVs differ."""
    source = scenes.creased_sheet(12)
    corners = np.array([list(polygon.vertices) for polygon in source.data.polygons])
    right = scenes.positions(source.data)[corners].mean(axis=1)[:, 0] > 0.0
    shared = np.intersect1d(corners[right], corners[~right])
    own = np.arange(len(source.data.vertices))
    own[shared] = len(own) + np.arange(len(shared))
    faces = np.where(right[:, None], own[corners], corners)
    points = scenes.positions(source.data)
    split = scenes.mesh_object("Split", np.concatenate([points, points[shared], [[9.0, 9.0, 9.0]]]), faces.tolist())
    level = split.data.attributes.new("level", "FLOAT", "POINT")
    level.data.foreach_set("value", scenes.positions(split.data)[:, 2].copy())
    split.vertex_groups.new(name="all").add(range(len(split.data.vertices)), 0.5, "REPLACE")
    split.data.edges[0].use_edge_sharp = True
    result = scenes.approximate()
    assert len(result.data.vertices) == len(split.data.vertices)
    assert np.allclose(scenes.positions(result.data)[-1], 9.0)
    made = resampled(2)
    assert len(made.data.vertices) == 23 * 23 + 1
    uses = {}
    for polygon in made.data.polygons:
        for key in polygon.edge_keys:
            uses[key] = uses.get(key, 0) + 1
    assert list(uses.values()).count(1) == 4 * 22
    carried = scenes.values(made.data, "level")[np.arange(len(points))]
    assert np.allclose(carried, points[:, 2], atol=1e-6)
    assert {round(entry.weight, 6) for vertex in made.data.vertices for entry in vertex.groups} == {0.5}
    assert sum(edge.use_edge_sharp for edge in made.data.edges) == 2


@pytest.mark.parametrize("name", ["representation", "splits", "stretch"])
def test_properties_that_others_made_are_refused_or_ignored(name):
    """Whoever makes a .blend can put anything into a custom property; what runs over it must not end in a traceback."""
    scenes.creased_sheet(12)
    scenes.approximate()
    source = bpy.context.view_layer.objects.active
    for value in ("text", 7, -1.5, [1.0], [float("nan")] * 9, [0.0] * 9, [1, 2, 3], b"PK\x03\x04", {"a": 1}):
        if f"sparse_surface_{name}" in source:
            del source[f"sparse_surface_{name}"]
        source[f"sparse_surface_{name}"] = value
        for operator in ("resample", "inspect_patch", "separate_patches", "domains_to_uv"):
            scenes.select(source)
            assert "Traceback" not in str(complaint(operator)), (operator, value)


def complaint(operator):
    """Return what an operator raises, if anything."""
    try:
        getattr(bpy.ops.sparse_surface, operator)()
    except RuntimeError as error:
        return error
    return None

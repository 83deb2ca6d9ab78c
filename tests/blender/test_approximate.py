"""The operator end to end: what comes out, where it stands, and that nothing else changes."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface.operators.data.meshes import read_mesh
from bl_ext.user_default.sparse_surface.solver import Settings, approximate
from mathutils import Euler, Matrix

sys.path.insert(0, str(Path(__file__).parent))
import scenes

REPORT_KEYS = {
    "version", "method", "settings", "input", "patches", "flipped_triangles", "passed_through_vertices", "vertex_error",
    "surface_error", "relative", "seam_max", "normal_error_degrees", "energy", "seconds", "peak_memory_mb", "workers",
}  # fmt: skip


def data_block_counts() -> dict[str, int]:
    return {
        name: len(getattr(bpy.data, name))
        for name in ("objects", "meshes", "materials", "collections", "node_groups", "images", "texts", "curves")
    }


def test_result_is_the_solvers_own():
    """The object holds what a plain call of the library gives on the same arrays, to the last bit."""
    source = scenes.creased_sheet()
    mesh = source.data
    before = scenes.positions(mesh)
    mesh.calc_loop_triangles()
    triangles = (
        np.array([t.vertices for t in mesh.loop_triangles]),
        np.array([t.polygon_index for t in mesh.loop_triangles]),
    )
    faces = [list(p.vertices) for p in mesh.polygons]
    expected = approximate(before, faces, Settings(iterations=3, sweeps=0, workers=1), triangles=triangles)
    made = scenes.approximate()
    assert made.name == "Sheet Sparse Surface" == made.data.name
    assert np.array_equal(scenes.positions(made.data), expected.vertices)
    assert np.array_equal(scenes.values(made.data, "error"), expected.error.astype(np.float32))
    assert np.array_equal(scenes.values(made.data, "patch"), expected.patch)
    assert np.array_equal(scenes.values(made.data, "domain_stretch"), expected.domain_stretch.astype(np.float32))
    assert np.array_equal(scenes.positions(mesh), before)


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
@pytest.mark.parametrize(
    "faces",
    [[[0, 1, 2, 3], [1, 4, 6, 5, 2], [3, 7, 0]], [[0, 1, 2], [2, 3, 0], [7, 0, 3]], []],
    ids=["mixed", "triangles", "none"],
)
def test_polygons_are_read_as_blender_lists_them(faces: list[list[int]], mode: str):
    """Triangles, quads and larger ones, or triangles alone; in Edit Mode a mesh has no attributes to copy."""
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 1), (2, 1, 1), (3, 0.5, 1), (-1, 0.5, 1)]
    mesh = scenes.mesh_object("Mixed", points, faces).data
    bpy.ops.object.mode_set(mode=mode)
    try:
        arrays = read_mesh(mesh)
        mesh.calc_loop_triangles()
        assert arrays.corners.tolist() == [vertex for face in faces for vertex in face]
        assert arrays.sizes.tolist() == [len(face) for face in faces]
        assert arrays.triangles.tolist() == [list(each.vertices) for each in mesh.loop_triangles]
        assert arrays.triangle_polygons.tolist() == [each.polygon_index for each in mesh.loop_triangles]
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")


def test_errors_are_those_of_the_stored_positions():
    source = scenes.creased_sheet()
    made = scenes.approximate()
    distance = np.linalg.norm(scenes.world_positions(made) - scenes.world_positions(source), axis=1)
    assert np.allclose(scenes.values(made.data, "error"), distance, rtol=1e-5, atol=1e-8)
    stored = made["sparse_surface"]["vertex_error"]
    assert stored["rms"] == pytest.approx(math.sqrt((distance**2).mean()), rel=1e-5)
    assert stored["max"] == pytest.approx(distance.max(), rel=1e-5)


def test_report_has_every_key_of_the_contract():
    source = scenes.creased_sheet()
    report = scenes.approximate()["sparse_surface"].to_dict()
    assert set(report) >= REPORT_KEYS
    assert set(report["input"]) >= {"vertices", "faces", "triangles", "components", "bounding_box_longest_side"}
    for kind in ("vertex_error", "surface_error"):
        bound = {"bound"} if kind == "surface_error" else set()
        assert set(report[kind]) == {"rms", "mean", "p95", "max", *bound}
    assert set(report["relative"]) >= {"vertex_rms", "vertex_max", "surface_rms", "surface_max"}
    assert set(report["seconds"]) >= {"cover", "domains", "solve", "blend", "total"}
    assert report["input"]["vertices"] == len(source.data.vertices)
    assert report["input"]["faces"] == len(source.data.polygons)
    assert report["settings"]["iterations"] == 3
    assert report["input"]["bounding_box_longest_side"] == pytest.approx(2.0)


def test_attributes_are_those_of_the_contract():
    scenes.creased_sheet()
    mesh = scenes.approximate().data
    kinds = {name: (layer.data_type, layer.domain) for name, layer in mesh.attributes.items()}
    assert kinds["error"] == ("FLOAT", "POINT")
    assert kinds["error_color"] == ("FLOAT_COLOR", "POINT")
    assert kinds["patch"] == ("INT", "POINT")
    assert kinds["domain_stretch"] == ("FLOAT", "FACE")
    assert mesh.color_attributes.active_color.name == "error_color"
    assert mesh.color_attributes[mesh.color_attributes.render_color_index].name == "error_color"
    assert scenes.values(mesh, "domain_stretch").min() >= 1.0 - 1e-5
    assert scenes.values(mesh, "patch").max() == bpy.context.object["sparse_surface"]["patches"] - 1


def test_nothing_but_the_result_is_made_and_the_source_is_untouched():
    source = scenes.creased_sheet()
    names, before = list(source.data.attributes.keys()), data_block_counts()
    made = scenes.approximate()
    assert data_block_counts() == {**before, "objects": before["objects"] + 1, "meshes": before["meshes"] + 1}
    assert list(source.data.attributes.keys()) == names
    assert source.hide_get()
    assert list(source.keys()) == ["sparse_surface_id", "sparse_surface_hidden"]
    assert bpy.context.selected_objects == [made]
    assert bpy.context.view_layer.objects.active == made


def test_the_same_input_gives_the_same_bytes():
    source = scenes.creased_sheet()
    first = scenes.approximate(replace_result=False)
    scenes.select(source)
    second = scenes.approximate(replace_result=False)
    assert first != second
    assert scenes.positions(first.data).tobytes() == scenes.positions(second.data).tobytes()
    assert scenes.values(first.data, "error").tobytes() == scenes.values(second.data, "error").tobytes()


def test_repeated_runs_replace_the_result_and_leave_nothing_behind():
    source = scenes.creased_sheet(12)
    made = scenes.approximate()
    counts = data_block_counts()
    for ring in (3, 4, 5):
        scenes.select(source)
        assert scenes.approximate(ring=ring) == made
        assert made["sparse_surface"]["settings"]["ring"] == ring
        assert data_block_counts() == counts
    assert made.data.name == made.name


def test_a_users_object_of_the_same_name_is_never_overwritten():
    scenes.mesh_object("Sheet Sparse Surface", [(0, 0, 0)], [])
    scenes.creased_sheet(12)
    made = scenes.approximate()
    assert made.name == "Sheet Sparse Surface.001"
    assert len(bpy.data.objects["Sheet Sparse Surface"].data.vertices) == 1


def test_long_names_are_cut_on_the_sources_side():
    scenes.creased_sheet(8, "ü" * 31)
    assert scenes.approximate().name.endswith(" Sparse Surface")


def shear(amount: float) -> Matrix:
    return Matrix(((1, amount, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)))


PLACES = {
    "rotated": Matrix.Translation((3, 4, 5)) @ Euler((0.3, 0.5, 0.7)).to_matrix().to_4x4(),
    "scaled": Matrix.Diagonal((2.0, 2.0, 2.0, 1.0)),
    "unevenly scaled": Matrix.Translation((1, 0, 0)) @ Matrix.Diagonal((1.0, 3.0, 0.5, 1.0)),
    "mirrored": Matrix.Diagonal((-1.0, 1.0, 1.0, 1.0)),
    "sheared": shear(0.8) @ Matrix.Diagonal((1.0, 2.0, -1.0, 1.0)),
}


@pytest.mark.parametrize("place", PLACES, ids=list(PLACES))
def test_lengths_are_world_lengths_wherever_the_object_stands(place):
    """The object is worked on as it looks in the world: the same as a copy whose scale was applied."""
    placed = scenes.creased_sheet()
    holder = bpy.data.objects.new("Holder", None)
    bpy.context.scene.collection.objects.link(holder)
    placed.parent = holder
    placed.matrix_parent_inverse = PLACES[place]  # the only way to stand sheared
    bpy.context.view_layer.update()
    made = scenes.approximate()
    report = made["sparse_surface"]
    distance = np.linalg.norm(scenes.world_positions(made) - scenes.world_positions(placed), axis=1)
    size = report["input"]["bounding_box_longest_side"]
    assert np.allclose(scenes.values(made.data, "error"), distance, atol=3e-7 * size)
    assert np.allclose(np.array(made.matrix_world), np.array(placed.matrix_world), atol=1e-6)
    assert made.parent == holder

    scenes.select()
    applied = placed.data.copy()
    applied.transform(PLACES[place])
    if PLACES[place].determinant() < 0.0:
        applied.flip_normals()
    reference = bpy.data.objects.new("Applied", applied)
    bpy.context.scene.collection.objects.link(reference)
    scenes.select(reference)
    expected = scenes.approximate()["sparse_surface"]
    assert report["patches"] == expected["patches"]
    # A rotation changes the last digits, and the iteration's choices magnify them.
    assert report["surface_error"]["rms"] == pytest.approx(expected["surface_error"]["rms"], rel=0.05)


def test_zero_scale_is_refused():
    source = scenes.creased_sheet(8)
    source.scale.z = 0.0
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="scale is zero"):
        bpy.ops.sparse_surface.approximate()


def test_modifiers_are_seen_or_ignored_as_asked():
    source = scenes.creased_sheet(12)
    modifier = source.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels = 1
    assert len(scenes.approximate().data.vertices) == 23 * 23
    scenes.select(source)
    base = scenes.approximate(use_modifiers=False)
    assert len(base.data.vertices) == 12 * 12
    assert not base.modifiers


def test_shape_keys_are_taken_in_and_left_behind():
    source = scenes.creased_sheet(12)
    source.shape_key_add(name="Basis")
    key = source.shape_key_add(name="Up")
    for point in key.data:
        point.co.z += 1.0
    key.value = 0.5
    made = scenes.approximate()
    assert made.data.shape_keys is None
    middle = scenes.positions(made.data)[:, 2].mean()
    assert middle == pytest.approx(scenes.positions(source.data)[:, 2].mean() + 0.5, abs=0.01)
    scenes.select(source)
    base = scenes.approximate(use_modifiers=False)
    assert base.data.shape_keys is None
    assert scenes.positions(base.data)[:, 2].mean() == pytest.approx(middle - 0.5, abs=0.01)


def test_vertex_group_weights_hold_vertices():
    source = scenes.creased_sheet()
    group = source.vertex_groups.new(name="Fit")
    free = [v.index for v in source.data.vertices if v.co.x > 0.0]
    group.add(free, 1.0, "REPLACE")
    made = scenes.approximate(vertex_group="Fit")
    moved = np.abs(scenes.positions(made.data) - scenes.positions(source.data)).max(axis=1) > 0.0
    held = np.setdiff1d(np.arange(len(moved)), free)
    assert not moved[held].any()
    assert moved[free].mean() > 0.5


def test_linked_duplicates_share_their_mesh_but_not_the_result():
    source = scenes.creased_sheet(12)
    twin = source.copy()
    bpy.context.scene.collection.objects.link(twin)
    twin.scale = (2, 2, 2)
    scenes.select(source, twin)
    scenes.approximate()
    assert source.data == twin.data
    one, two = (bpy.data.objects[f"{each.name} Sparse Surface"] for each in (source, twin))
    assert one.data != two.data
    ratio = two["sparse_surface"]["surface_error"]["rms"] / one["sparse_surface"]["surface_error"]["rms"]
    assert ratio == pytest.approx(2.0, rel=0.05)


def test_several_objects_are_done_and_the_bad_ones_named(capfd):
    good = [scenes.creased_sheet(12, name) for name in ("One", "Two")]
    empty = scenes.mesh_object("Empty", [], [])
    light = bpy.data.objects.new("Light", bpy.data.lights.new("Light", "POINT"))
    bpy.context.scene.collection.objects.link(light)
    scenes.select(*good, empty, light)
    scenes.approximate()
    assert {o.name for o in bpy.context.selected_objects} == {"One Sparse Surface", "Two Sparse Surface"}
    assert "Empty Sparse Surface" not in bpy.data.objects
    said = "".join(capfd.readouterr())
    assert "'Empty': " in said
    assert said.count("surface error rms") == 2


def test_result_is_linked_beside_its_source():
    collection = bpy.data.collections.new("Mine")
    bpy.context.scene.collection.children.link(collection)
    source = scenes.creased_sheet(12)
    collection.objects.link(source)
    bpy.context.scene.collection.objects.unlink(source)
    scenes.select(source)
    assert list(scenes.approximate().users_collection) == [collection]


def test_library_objects_can_be_approximated(tmp_path):
    scenes.creased_sheet(12)
    path = str(tmp_path / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (there, here):
        here.objects = there.objects
    linked = here.objects[0]
    bpy.context.scene.collection.objects.link(linked)
    scenes.select(linked)
    made = scenes.approximate()
    assert made.library is None
    assert made.data.library is None
    assert len(made.data.vertices) == 144


def test_undo_takes_everything_back_in_one_step(run_bpy):
    """In a process of its own: undo reads the whole file back."""
    done = run_bpy(
        f"""
import sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
import bpy
import scenes
bpy.ops.wm.read_homefile(use_empty=True)
scenes.enable_extension()
scenes.creased_sheet(12)
bpy.ops.ed.undo_push(message="sheet")
scenes.hurry()
bpy.ops.ed.undo_push(message="settings")
assert bpy.ops.sparse_surface.approximate("EXEC_DEFAULT", True) == {{"FINISHED"}}
assert "Sheet Sparse Surface" in bpy.data.objects
bpy.ops.ed.undo()
assert [o.name for o in bpy.data.objects] == ["Sheet"], list(bpy.data.objects)
assert bpy.context.scene.sparse_surface.iterations == 3
bpy.ops.ed.redo()
made = bpy.data.objects["Sheet Sparse Surface"]
assert made["sparse_surface"]["patches"] >= 1 and "error" in made.data.attributes
print("undone and redone")
"""
    )
    assert "undone and redone" in done.stdout, done.stdout + done.stderr


def test_result_survives_saving_and_loading(tmp_path):
    scenes.creased_sheet(12)
    made = scenes.approximate()
    report, error = made["sparse_surface"].to_dict(), scenes.values(made.data, "error")
    path = str(tmp_path / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    loaded = bpy.data.objects["Sheet Sparse Surface"]
    assert loaded["sparse_surface"].to_dict() == report
    assert np.array_equal(scenes.values(loaded.data, "error"), error)

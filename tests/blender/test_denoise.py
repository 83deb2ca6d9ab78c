"""Denoising in Blender: the preset, the strength, what is said and shown, in the object's own units."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface.benchmarks import generated_models as models
from bl_ext.user_default.sparse_surface.operators.data.report_text import rows
from bl_ext.user_default.sparse_surface.operators.heat_map.picture import render_heatmap
from bl_ext.user_default.sparse_surface.operators.run.estimate import estimate
from bl_ext.user_default.sparse_surface.solver import Settings, approximate
from mathutils import Matrix, Vector

sys.path.insert(0, str(Path(__file__).parent))
import scenes

NOISE = 0.005


def noisy_cube(level: float = NOISE, name: str = "Scan") -> Any:
    """Return a selected cube of quads, edge length 1, with noise in all directions."""
    vertices, faces = models.cube()
    vertices = vertices + np.random.default_rng(3).normal(0.0, level, vertices.shape)
    return scenes.mesh_object(name, vertices, faces.tolist())


def denoised_cube() -> tuple[Any, np.ndarray, Any, np.ndarray]:
    """Return a noisy cube and what denoising makes of it, each with its positions."""
    source = noisy_cube()
    before = scenes.positions(source.data)
    result = scenes.approximate(denoise="only")
    return source, before, result, scenes.positions(result.data)


def take_preset(name: str) -> None:
    from bl_ext.user_default.sparse_surface.ui.presets import SPARSE_SURFACE_MT_presets

    (path,) = [
        Path(folder) / f"{name}.py"
        for folder in bpy.utils.preset_paths(SPARSE_SURFACE_MT_presets.preset_subdir)
        if (Path(folder) / f"{name}.py").is_file()
    ]
    assert bpy.ops.script.execute_preset(filepath=str(path), menu_idname="SPARSE_SURFACE_MT_presets") == {"FINISHED"}


def from_clean_planes(points: np.ndarray) -> np.ndarray:
    """Return the distance of each point from the surface of the cube of edge length 1."""
    return np.abs(np.abs(points).max(axis=1) - 0.5)


def test_the_preset_takes_the_noise_off_the_selected_mesh():
    source = noisy_cube()
    before = scenes.positions(source.data).copy()
    take_preset("denoise")
    assert bpy.context.scene.sparse_surface.denoise == "only"
    result = scenes.approximate()
    after = scenes.positions(result.data)
    assert np.array_equal(scenes.positions(source.data), before)
    assert from_clean_planes(after).std() < 0.2 * from_clean_planes(before).std()
    faces = [list(polygon.vertices) for polygon in source.data.polygons]
    expected = approximate(before, np.array(faces), Settings(denoise="only", workers=1))
    assert np.allclose(after, expected.vertices, atol=1e-6)
    assert {len(polygon.vertices) for polygon in result.data.polygons} == {4}


def test_figures_and_attributes_say_what_was_taken_off():
    source = noisy_cube()
    result = scenes.approximate(denoise="only")
    moved = np.linalg.norm(scenes.positions(result.data) - scenes.positions(source.data), axis=1)
    assert np.allclose(scenes.values(result.data, "error"), moved, atol=1e-6)
    assert (scenes.values(result.data, "patch") == -1).all()
    report = result["sparse_surface"].to_dict()
    assert report["denoise"]["noise_level"] == pytest.approx(NOISE, rel=0.1)
    assert report["denoise"]["displacement"]["max"] == pytest.approx(moved.max(), rel=1e-4)
    listed = dict(rows(report))
    assert listed["Noise removed"] == report["denoise"]["noise_level"]
    assert "Fit to the denoised, rms" not in listed
    assert estimate(2000, Settings(denoise="only")).patches == 0 < estimate(2000, Settings()).patches


def test_noise_is_measured_in_the_world():
    source = noisy_cube()
    source.matrix_world = Matrix.LocRotScale(Vector((3.0, 0.0, -1.0)), None, Vector((10.0, 10.0, 10.0)))
    result = scenes.approximate(denoise="only")
    assert result["sparse_surface"]["denoise"]["noise_level"] == pytest.approx(10.0 * NOISE, rel=0.1)
    own = scenes.positions(result.data)
    scenes.select(source)
    result = scenes.approximate(denoise="only", noise_level=10.0 * NOISE)
    assert result["sparse_surface"]["denoise"]["noise_level"] == pytest.approx(10.0 * NOISE, rel=1e-6)
    assert np.allclose(scenes.positions(result.data), own, atol=NOISE)


def test_strength_and_fit_on_request():
    source = noisy_cube()
    moved = []
    for strength in (0.0, 0.5, 1.0):
        scenes.select(source)
        result = scenes.approximate(denoise="only", denoise_strength=strength)
        moved.append(scenes.values(result.data, "error").max())
    assert moved[0] == 0.0 < moved[1] < moved[2]
    scenes.select(source)
    result = scenes.approximate(denoise="first", ring=4, degree=8, sparsity=8)
    report = result["sparse_surface"].to_dict()
    assert report["patches"] > 0
    assert 0.0 < report["denoise"]["fit"]["surface_error"]["rms"] < report["surface_error"]["rms"]
    assert "Fit to the denoised, rms" in dict(rows(report))
    assert bpy.ops.sparse_surface.resample(splits=2) == {"FINISHED"}
    fine = bpy.context.view_layer.objects.active
    assert len(fine.data.polygons) == 4 * len(source.data.polygons)


def test_a_denoised_mesh_can_be_resampled_and_looked_at():
    noisy_cube()
    result = scenes.approximate(denoise="only")
    assert bpy.ops.sparse_surface.resample(splits=2) == {"FINISHED"}
    fine = bpy.context.view_layer.objects.active
    count = len(result.data.vertices)
    # the compact form that a .blend carries moves the input's vertices by up to 3e-5 of the longest side
    assert np.allclose(scenes.positions(fine.data)[:count], scenes.positions(result.data), atol=3e-5)
    scenes.select(result)
    with pytest.raises(RuntimeError, match="has no patches"):
        bpy.ops.sparse_surface.inspect_patch()


def test_a_clean_mesh_stays_as_it_is():
    vertices, faces = models.cube()
    source = scenes.mesh_object("Clean", vertices, faces.tolist())
    result = scenes.approximate(denoise="only")
    assert scenes.positions(result.data).tobytes() == scenes.positions(source.data).tobytes()
    assert not scenes.values(result.data, "error").any()


def test_held_vertices_stay():
    source = noisy_cube()
    group = source.vertex_groups.new(name="Moves")
    group.add(list(range(0, len(source.data.vertices), 2)), 1.0, "REPLACE")
    result = scenes.approximate(denoise="only", vertex_group="Moves")
    before, after = scenes.positions(source.data), scenes.positions(result.data)
    assert np.array_equal(before[1::2], after[1::2])
    assert not np.array_equal(before[::2], after[::2])


def test_the_picture_tells_of_noise_not_of_patches(tmp_path, monkeypatch):
    from bl_ext.user_default.sparse_surface.operators.heat_map import picture

    noisy_cube()
    result = scenes.approximate(denoise="only")
    written = []
    monkeypatch.setattr(picture.Lettering, "write", lambda _, text, *__, **___: written.append(text))
    monkeypatch.setattr(picture, "write_png", lambda path, colours: None)
    render_heatmap(result, tmp_path / "picture.png")
    assert any(text.startswith("noise of 0.00") for text in written)


def seen(made: Any) -> np.ndarray:
    """Return the local positions in which an object is drawn."""
    bpy.context.view_layer.update()
    return scenes.positions(made.evaluated_get(bpy.context.evaluated_depsgraph_get()).data)


def test_the_strength_of_a_result_blends_at_once():
    _, before, result, after = denoised_cube()
    inspection = bpy.context.scene.sparse_surface.inspection
    assert inspection.strength == 1.0
    assert result.data.shape_keys is None
    inspection.strength = 1.0
    assert result.data.shape_keys is None, "a key without need"
    for share in (0.5, 0.25, 0.0, 1.0):
        inspection.strength = share
        assert inspection.strength == pytest.approx(share)
        np.testing.assert_allclose(seen(result), before + share * (after - before), atol=1e-6)
    np.testing.assert_array_equal(seen(result), after)
    assert [key.name for key in result.data.shape_keys.key_blocks] == ["Denoised", "Noise"]
    np.testing.assert_array_equal(scenes.positions(result.data), after)


def test_noise_stays_where_a_vertex_group_of_its_key_says_so():
    _, before, result, after = denoised_cube()
    bpy.context.scene.sparse_surface.inspection.strength = 0.0
    weights = np.linspace(0.0, 1.0, len(before))
    group = result.vertex_groups.new(name="Rough")
    for vertex, weight in enumerate(weights.tolist()):
        group.add([vertex], weight, "REPLACE")
    result.data.shape_keys.key_blocks["Noise"].vertex_group = "Rough"
    np.testing.assert_allclose(seen(result), after + weights[:, None] * (before - after), atol=1e-6)


def test_the_source_gets_what_is_seen():
    source, before, result, after = denoised_cube()
    bpy.context.scene.sparse_surface.inspection.strength = 0.75
    assert bpy.ops.sparse_surface.apply_to_source() == {"FINISHED"}
    np.testing.assert_allclose(scenes.positions(source.data), before + 0.75 * (after - before), atol=1e-6)
    assert [key.name for key in result.data.shape_keys.key_blocks] == ["Denoised", "Noise"]


def test_the_strength_outlives_a_saved_file_and_a_lost_source(tmp_path):
    source = noisy_cube()
    before = scenes.positions(source.data)
    result = scenes.approximate(denoise="only")
    after, name = scenes.positions(result.data), result.name
    bpy.data.objects.remove(source)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "denoised.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "denoised.blend"))
    result = bpy.data.objects[name]
    scenes.select(result)
    bpy.context.scene.sparse_surface.inspection.strength = 0.5
    np.testing.assert_allclose(seen(result), 0.5 * (before + after), atol=1e-6)


def test_other_objects_have_no_strength_and_denoising_again_starts_afresh():
    source = noisy_cube()
    inspection = bpy.context.scene.sparse_surface.inspection
    inspection.strength = 0.5
    assert source.data.shape_keys is None
    assert inspection.strength == 1.0
    result = scenes.approximate(denoise="only")
    inspection.strength = 0.5
    scenes.select(source)
    again = scenes.approximate(denoise="only")
    assert again == result
    assert inspection.strength == 1.0
    scenes.select(source)
    fitted = scenes.approximate(denoise="first", ring=4, degree=8, sparsity=8)
    assert "noisy_position" not in fitted.data.attributes


def test_a_group_of_the_attributes_name_gives_way():
    source = noisy_cube()
    source.vertex_groups.new(name="noisy_position").add([0], 1.0, "REPLACE")
    result = scenes.approximate(denoise="only")
    assert [group.name for group in result.vertex_groups] == ["noisy_position (source)"]
    np.testing.assert_array_equal(
        scenes.values(result.data, "noisy_position", "vector", 3), scenes.positions(source.data)
    )

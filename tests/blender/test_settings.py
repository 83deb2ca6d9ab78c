"""Settings: the scene's are the solver's, presets are Blender's, words can be translated."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import bpy
import pytest
from bl_ext.user_default.sparse_surface.operators.data import presets
from bl_ext.user_default.sparse_surface.operators.run.estimate import estimate
from bl_ext.user_default.sparse_surface.solver.settings import PRESETS, Settings
from bl_ext.user_default.sparse_surface.ui import advanced_panel, properties

sys.path.insert(0, str(Path(__file__).parent))
import scenes

FIELDS = {item.name: item for item in dataclasses.fields(Settings)}


def scene_settings():
    return bpy.context.scene.sparse_surface


def test_defaults_are_the_solvers():
    assert scene_settings().to_settings() == Settings()


@pytest.mark.parametrize("name", FIELDS)
def test_each_property_has_the_solvers_range_and_text(name):
    item, drawn = FIELDS[name], properties.SparseSurfaceSettings.bl_rna.properties[name]
    assert drawn.description == item.metadata["text"]
    if "choices" in item.metadata:
        assert {each.identifier: each.description for each in drawn.enum_items} == dict(item.metadata["choices"])
    elif not isinstance(item.default, bool):
        assert drawn.hard_min == pytest.approx(item.metadata["low"])
        assert drawn.hard_max == pytest.approx(item.metadata["high"])
        assert (drawn.soft_min, drawn.soft_max) == pytest.approx(item.metadata["soft"])


def test_tolerance_is_a_length():
    drawn = properties.SparseSurfaceSettings.bl_rna.properties["tolerance"]
    assert (drawn.subtype, drawn.unit) == ("DISTANCE", "LENGTH")


def test_every_setting_is_on_a_panel():
    groups = ("OF_JOBS", "PATCHES", "DOMAIN", "PAPER", "OF_ONE_METHOD", "OUTPUT", "MORE")
    placed = [name for group in groups for name in getattr(advanced_panel, group)]
    assert sorted(placed) == sorted(FIELDS)


@pytest.mark.parametrize("name", PRESETS)
def test_shipped_presets_are_the_solvers(name):
    paths = [
        Path(folder) / f"{name}.py"
        for folder in bpy.utils.preset_paths("sparse_surface")
        if (Path(folder) / f"{name}.py").exists()
    ]
    assert len(paths) == 1
    scenes.hurry(ring=3, beta1=0.7)
    assert scene_settings().to_settings() != Settings(**PRESETS[name])
    bpy.ops.script.execute_preset(filepath=str(paths[0]), menu_idname="SPARSE_SURFACE_MT_presets")
    assert scene_settings().to_settings() == Settings(**PRESETS[name])


def test_a_users_preset_can_be_saved_and_taken(user_folder):
    scenes.hurry(ring=5, tolerance=0.125, method="paper")
    wanted = scene_settings().to_settings()
    assert bpy.ops.sparse_surface.preset_add(name="Mine") == {"FINISHED"}
    saved = list((user_folder / "scripts").rglob("presets/sparse_surface/*.py"))
    assert [path.stem.lower() for path in saved] == ["mine"]
    scene_settings().apply_preset("default")
    assert presets.matching_preset(scene_settings().to_settings()) == "default"
    bpy.ops.script.execute_preset(filepath=str(saved[0]), menu_idname="SPARSE_SURFACE_MT_presets")
    assert scene_settings().to_settings() == wanted
    assert presets.preset_title(presets.matching_preset(wanted)) == "Mine"
    comparison = scene_settings().comparison
    comparison.first, comparison.second = f"PRESET_{saved[0].stem}", "PRESET_fast"
    assert Settings.from_dict(presets.preset_values(saved[0].stem)) == wanted
    own = bpy.context.preferences.addons[scenes.EXTENSION].preferences
    own.default_preset = saved[0].stem
    assert own.default_preset == saved[0].stem
    own.default_preset = "default"
    saved[0].unlink()


def test_the_active_preset_is_known_by_its_settings():
    for name in PRESETS:
        scene_settings().apply_preset(name)
        scene_settings().workers = 3
        assert presets.matching_preset(scene_settings().to_settings()) == name
    scene_settings().apply_preset("fast")
    scene_settings().tolerance = 0.5
    assert presets.matching_preset(scene_settings().to_settings()) == "fast"
    scene_settings().ring = 9
    assert presets.matching_preset(scene_settings().to_settings()) == ""


def test_default_preset_is_given_to_scenes_that_nobody_touched():
    own = bpy.context.preferences.addons[scenes.EXTENSION].preferences
    try:
        own.default_preset = "precise"
        assert scene_settings().domains == "separate"
        scene_settings().apply_preset("default")
        bpy.ops.wm.read_homefile(use_empty=True)
        assert scene_settings().domains == "separate"
        touched = bpy.data.scenes.new("Touched")
        touched.sparse_surface.ring = 4
        own.default_preset = "fast"
        assert touched.sparse_surface.iterations == Settings().iterations
    finally:
        own.default_preset = "default"


def test_preferred_workers_are_used_where_the_scene_names_none():
    from bl_ext.user_default.sparse_surface.operators.run.preferences import preferred_workers

    own = bpy.context.preferences.addons[scenes.EXTENSION].preferences
    try:
        own.workers = 1
        assert preferred_workers(bpy.context) == 1
        scenes.creased_sheet(12)
        assert scenes.approximate(workers=0)["sparse_surface"]["workers"] == 1
    finally:
        own.workers = 0


@pytest.mark.parametrize(("vertices", "ring", "patches"), [(1538, 7, 20), (6475, 7, 100), (34834, 7, 535)])
def test_estimated_patches_are_about_those_of_real_models(vertices, ring, patches):
    assert estimate(vertices, Settings(ring=ring)).patches == pytest.approx(patches, rel=0.25)


def test_estimated_time_grows_with_the_work():
    base = estimate(10_000, Settings()).seconds
    assert estimate(20_000, Settings()).seconds == pytest.approx(2.0 * base)
    assert estimate(10_000, Settings(domains="separate")).seconds > 1.5 * base
    assert estimate(10_000, Settings(method="traditional")).seconds < 0.5 * base

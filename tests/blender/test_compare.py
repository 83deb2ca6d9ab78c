"""Two methods side by side on one colour scale."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface.operators.data.colours import ColourScale

sys.path.insert(0, str(Path(__file__).parent))
import scenes


def compare(**settings: Any) -> list[Any]:
    """Compare these settings with those of the preset `fast`."""
    scenes.hurry(**settings)
    bpy.context.scene.sparse_surface.comparison.second = "PRESET_fast"
    assert bpy.ops.sparse_surface.compare_methods() == {"FINISHED"}
    return sorted(bpy.context.selected_objects, key=lambda made: made.name)


def test_both_results_have_one_scale_and_their_own_settings():
    source = scenes.creased_sheet(14)
    one, other = compare(ring=4, method="traditional")
    assert (one.name, other.name) == ("Sheet Sparse Surface 1 Traditional", "Sheet Sparse Surface 2 Fast")
    reports = [made["sparse_surface"].to_dict() for made in (one, other)]
    assert [report["method"] for report in reports] == ["traditional", "default"]
    assert [report["settings"]["iterations"] for report in reports] == [3, 6]
    largest = max(float(scenes.values(made.data, "error").max()) for made in (one, other))
    for made in (one, other):
        low, high, tolerance = made["error_color_range"]
        assert (low, tolerance) == (0.0, 0.0)
        assert high == pytest.approx(largest, rel=1e-5)
        error = scenes.values(made.data, "error")
        expected = ColourScale(0.0, high).colours(error)
        assert np.allclose(scenes.values(made.data, "error_color", "color", 4), expected, atol=1e-6)
    assert source.hide_get()


def test_they_stand_beside_each_other():
    source = scenes.creased_sheet(12)
    source.rotation_euler = (0.2, 0.3, 0.9)
    one, other = compare(ring=4)
    boxes = [scenes.world_positions(made) for made in (source, one, other)]
    for left, right in ((0, 1), (1, 2)):
        assert boxes[left][:, 0].max() < boxes[right][:, 0].min()
        assert np.allclose(boxes[left][:, 1:].mean(axis=0), boxes[right][:, 1:].mean(axis=0), atol=0.05)


def test_on_request_both_stay_in_place():
    source = scenes.creased_sheet(12)
    bpy.context.scene.sparse_surface.comparison.beside = False
    for made in compare(ring=4):
        assert made.matrix_world == source.matrix_world


def test_the_scale_stays_common_when_colours_are_made_anew():
    scenes.creased_sheet(12)
    one, other = compare(ring=4, method="traditional")
    display = bpy.context.scene.sparse_surface.display
    before = list(one["error_color_range"])
    for mode in ("PERCENTILE", "AUTOMATIC"):
        display.range_mode = mode
        assert list(one["error_color_range"]) == list(other["error_color_range"])
        same = list(one["error_color_range"]) == pytest.approx(before, rel=1e-6)
        assert same == (mode == "AUTOMATIC")


def test_no_setting_is_changed():
    scenes.creased_sheet(12)
    settings = scenes.hurry(ring=4)

    def everything(group: Any) -> dict[str, Any]:
        return {
            each.identifier: everything(getattr(group, each.identifier))
            if each.identifier in {"display", "reconstruction", "comparison"}
            else str(getattr(group, each.identifier))
            for each in group.bl_rna.properties
            if each.identifier != "rna_type"
        }

    before = everything(settings)
    assert bpy.ops.sparse_surface.compare_methods() == {"FINISHED"}
    assert everything(settings) == before


@pytest.mark.parametrize("replace", [True, False])
def test_results_of_an_earlier_comparison_are_replaced_unless_they_are_to_stay(replace: bool):
    """The second time with a result selected: its source is compared."""
    source = scenes.creased_sheet(12)
    bpy.context.scene.sparse_surface.replace_result = replace
    first = compare(ring=4)
    scenes.select(first[0])
    second = compare(ring=5)
    assert (first == second) == replace
    assert len([o for o in bpy.data.objects if "sparse_surface" in o]) == (2 if replace else 4)
    assert [made["sparse_surface_source"] for made in second] == [source["sparse_surface_id"]] * 2


def test_what_cannot_be_compared_is_said():
    first, second = scenes.creased_sheet(8), scenes.creased_sheet(8, "Other")
    comparison = bpy.context.scene.sparse_surface.comparison
    scenes.select(first, second)
    assert not bpy.ops.sparse_surface.compare_methods.poll()
    scenes.select(first)
    assert bpy.ops.sparse_surface.compare_methods.poll()
    comparison.second = comparison.first
    assert not bpy.ops.sparse_surface.compare_methods.poll()
    comparison.second = "PRESET_paper"
    scenes.select()
    assert not bpy.ops.sparse_surface.compare_methods.poll()


def test_a_refused_mesh_leaves_nothing_behind():
    mesh = bpy.data.meshes.new("Flat")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [], [(0, 1, 2)])
    flat = bpy.data.objects.new("Flat", mesh)
    bpy.context.scene.collection.objects.link(flat)
    scenes.select(flat)
    scenes.hurry()
    with pytest.raises(RuntimeError, match="no area"):
        bpy.ops.sparse_surface.compare_methods()
    assert len(bpy.data.objects) == len(bpy.data.meshes) == 1

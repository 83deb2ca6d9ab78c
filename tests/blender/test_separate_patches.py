"""Patches as objects of their own: as many as the report says, each its own surface, gaps measured."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import scenes


@pytest.fixture
def result():
    sheet = scenes.creased_sheet(24)
    sheet.location, sheet.rotation_euler = (1.0, 2.0, 3.0), (0.3, 0.2, 0.1)
    bpy.context.view_layer.update()
    return scenes.approximate(ring=5, method="traditional", degree=8)


def test_every_patch_becomes_an_object_where_the_result_is(result):
    assert bpy.ops.sparse_surface.separate_patches() == {"FINISHED"}
    made = bpy.data.collections[f"{result.name} Patches"].objects
    assert len(made) == result["sparse_surface"]["patches"] > 2
    surface = scenes.world_positions(result)
    for patch in made:
        points = scenes.world_positions(patch)
        distances = np.linalg.norm(points[:, None] - surface[None], axis=2).min(axis=1)
        assert distances.max() < 0.3
        assert len(patch.data.polygons) > 20
    assert len({tuple(patch.color) for patch in made}) == len(made)


def test_gaps_are_measured_where_patches_overlap(result):
    bpy.ops.sparse_surface.separate_patches()
    made = bpy.data.collections[f"{result.name} Patches"].objects
    gaps = np.concatenate([scenes.values(patch.data, "gap") for patch in made])
    assert gaps.min() >= 0.0
    assert 1e-4 < gaps.max() < 0.5


def test_a_mesh_that_is_no_result_has_no_patches():
    scenes.creased_sheet(8)
    assert not bpy.ops.sparse_surface.separate_patches.poll()


def test_an_edited_result_is_refused_and_nothing_is_made(result):
    result.data.vertices[0].co.x += 1.0
    with pytest.raises(RuntimeError, match="edited"):
        bpy.ops.sparse_surface.separate_patches()
    assert not [c for c in bpy.data.collections if c.name.endswith("Patches")]

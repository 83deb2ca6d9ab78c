"""The sample scene: what each job needs is there, works, and leaves the user's own scene alone."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import scenes


def opened() -> dict[str, bpy.types.Object]:
    assert bpy.ops.sparse_surface.open_sample() == {"FINISHED"}
    return {each.name: each for each in bpy.context.scene.objects}


def test_it_opens_beside_the_users_own_scene_and_only_once():
    own, sheet = bpy.context.scene, scenes.creased_sheet(8)
    made = opened()
    assert set(made) == {"Sharp Part", "Noisy Scan", "Points"}
    assert bpy.context.scene != own
    assert list(own.objects) == [sheet]
    bpy.context.window.scene = own
    opened()
    assert len(bpy.data.scenes) == 2


def test_each_job_has_an_object_that_it_works_on():
    made = opened()
    assert bpy.context.view_layer.objects.active == made["Sharp Part"]
    assert bpy.ops.sparse_surface.approximate.poll()
    part = made["Sharp Part"].data
    faces = np.array([each.normal for each in part.polygons])
    beside: dict[tuple[int, int], list[int]] = {}
    for polygon in part.polygons:
        for key in polygon.edge_keys:
            beside.setdefault(key, []).append(polygon.index)
    assert {len(pair) for pair in beside.values()} == {2}, "closed"
    bends = np.array([faces[a] @ faces[b] for a, b in beside.values()])
    assert (bends < np.cos(np.radians(15.0))).sum() > 100, "sharp edges"
    scenes.select(made["Noisy Scan"])
    scenes.hurry()
    assert bpy.ops.sparse_surface.approximate(only_denoise=True) == {"FINISHED"}
    level = bpy.context.object["sparse_surface"]["denoise"]["noise_level"]
    assert 0.005 < level < 0.011  # 0.008 was added
    scenes.select(made["Points"])
    assert bpy.context.scene.sparse_surface.job == "RECONSTRUCT"
    assert bpy.ops.sparse_surface.reconstruct.poll()

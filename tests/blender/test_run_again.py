"""Run Again: the settings of a result, not those of the panel, solve its source once more."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface.benchmarks.generated_clouds import ball

sys.path.insert(0, str(Path(__file__).parent))
import scenes


def test_the_settings_of_the_result_are_taken_and_it_is_replaced():
    scenes.creased_sheet(14)
    made = scenes.approximate(ring=4, degree=9, tolerance=0.05)
    first, settings = scenes.positions(made.data), bpy.context.scene.sparse_surface
    settings.ring, settings.degree, settings.tolerance, settings.workers = 7, 14, 0.0, 1
    assert bpy.ops.sparse_surface.run_again() == {"FINISHED"}
    assert bpy.context.object == made
    assert len(bpy.data.objects) == 2
    assert np.array_equal(scenes.positions(made.data), first)
    assert (settings.ring, settings.degree) == (4, 9)
    assert settings.tolerance == pytest.approx(0.05)


def test_points_are_reconstructed_again():
    cloud = ball(400)
    scenes.mesh_object("Scan", cloud.points, [])
    settings = scenes.hurry(degree=8)
    settings.reconstruction.corrections = 1
    assert bpy.ops.sparse_surface.reconstruct() == {"FINISHED"}
    made = bpy.context.object
    settings.degree = 14
    assert bpy.ops.sparse_surface.run_again() == {"FINISHED"}
    assert bpy.context.object == made
    assert made["sparse_surface"]["settings"]["degree"] == 8


def test_settings_of_another_version_are_refused_in_one_sentence():
    scenes.creased_sheet(12)
    made = scenes.approximate(ring=4)
    made["sparse_surface"]["settings"]["fancy"] = 3
    bpy.context.scene.sparse_surface.ring = 6
    with pytest.raises(RuntimeError, match="no setting named 'fancy'"):
        bpy.ops.sparse_surface.run_again()
    assert bpy.context.scene.sparse_surface.ring == 6


def test_only_a_result_whose_source_is_there_runs_again():
    source = scenes.creased_sheet(12)
    assert not bpy.ops.sparse_surface.run_again.poll()
    scenes.approximate(ring=4)
    assert bpy.ops.sparse_surface.run_again.poll()
    bpy.data.objects.remove(source)
    assert not bpy.ops.sparse_surface.run_again.poll()

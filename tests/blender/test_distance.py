"""Measuring distances between objects of a scene: which pairs, what the results carry, measuring again."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface.operators.heat_map.probe import read_at
from mathutils import Vector

sys.path.insert(0, str(Path(__file__).parent))
import scenes

RISE = 0.3


def sheet(name: str, rise: float = 0.0, lift: float = 0.0):
    """Return a sheet over [-1, 1] x [-1, 1] that rises along x from `lift` to `lift` + `rise`."""
    axis = np.linspace(-1.0, 1.0, 11)
    x, y = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
    corner = (np.arange(10)[:, None] * 11 + np.arange(10)).ravel()
    faces = np.stack([corner, corner + 11, corner + 12, corner + 1], axis=1)
    return scenes.mesh_object(name, np.stack([x, y, lift + rise * (x + 1.0) / 2.0], axis=1), faces.tolist())


def measure(**settings):
    assert bpy.ops.sparse_surface.distance(samples=500, **settings) == {"FINISHED"}
    return bpy.context.view_layer.objects.active


def test_each_vertex_has_its_distance_and_the_point_measured_to():
    truth, part = sheet("Truth"), sheet("Part", RISE)
    part.location.y = 0.25
    scenes.select(truth, part)
    made = measure()
    height = scenes.world_positions(made)[:, 2]
    over = np.abs(scenes.world_positions(made)[:, 1]) <= 1.0
    np.testing.assert_allclose(scenes.values(made.data, "error")[over], height[over], atol=1e-6)
    partner = scenes.values(made.data, "partner", "vector", 3)
    assert np.abs(partner[:, 2]).max() < 1e-6
    assert np.abs(partner[:, :2]).max() < 1.0 + 1e-6
    read = read_at(made, Vector((1.0, 0.4, 0.2)))
    assert read.value == pytest.approx(RISE, abs=1e-6)
    assert (read.place - read.partner).length == pytest.approx(RISE, abs=1e-6)


def test_the_shares_are_those_of_the_area():
    truth, part = sheet("Truth"), sheet("Part", RISE)
    bpy.context.scene.sparse_surface.display.inside_outside = True
    bpy.context.scene.sparse_surface.display.tolerance = 0.75 * RISE
    try:
        scenes.select(truth, part)
        made = measure()
        bpy.context.view_layer.update()
        from bl_ext.user_default.sparse_surface.operators.heat_map.scale import recolour_scene

        recolour_scene(bpy.context.scene)
        inside, outside = made["error_color_shares"]
    finally:
        bpy.context.scene.sparse_surface.display.inside_outside = False
    assert inside + outside == pytest.approx(1.0)
    assert inside == pytest.approx(0.75, abs=0.06)  # half a row of faces is a twentieth


def test_measuring_again_takes_the_same_two_and_replaces_the_distances():
    truth, part = sheet("Truth"), sheet("Part", RISE)
    scenes.select(truth, part)
    first = measure()
    assert first.name == "Part Distance"
    assert part.hide_get()
    scenes.select(first)
    again = measure(signed=True)
    assert [each.name for each in bpy.data.objects if each.name.startswith("Part Distance")] == ["Part Distance"]
    assert json.loads(again["sparse_surface_distance"])["settings"]["signed"] is True
    assert next(iter(again["error_color_range"])) < 0.0  # signs keep their colours where none is negative


def test_a_reference_measures_all_that_are_selected():
    truth = sheet("Truth")
    parts = [sheet(name, RISE, lift) for name, lift in (("One", 0.0), ("Two", 0.1), ("Three", 0.2))]
    scenes.select(*parts)
    assert not bpy.ops.sparse_surface.distance.poll()  # against which?
    bpy.context.scene.sparse_surface.measurement.reference = truth
    try:
        measure()
        for part, lift in zip(parts, (0.0, 0.1, 0.2), strict=True):
            made = bpy.data.objects[f"{part.name} Distance"]
            assert scenes.values(made.data, "error").max() == pytest.approx(RISE + lift, abs=1e-6)
        scenes.select(truth)
        assert not bpy.ops.sparse_surface.distance.poll()
    finally:
        bpy.context.scene.sparse_surface.measurement.reference = None


def test_points_stay_points_with_a_body_each():
    truth = sheet("Truth")
    cloud = scenes.mesh_object("Cloud", [(0.1 * k - 0.5, 0.0, 0.05 * k) for k in range(10)], [])
    scenes.select(truth, cloud)
    made = measure()
    assert len(made.data.vertices) == 10
    np.testing.assert_allclose(scenes.values(made.data, "error"), 0.05 * np.arange(10), atol=1e-6)
    evaluated = made.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    assert len(evaluated.polygons) >= 10 * 20
    assert evaluated.color_attributes.active_color.name == "error_color"  # what viewports show

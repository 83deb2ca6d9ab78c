"""Creases that the optimisation found become sharp edges of the result."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface.benchmarks.generated_models import cube
from bl_ext.user_default.sparse_surface.operators.data import report_text
from bl_ext.user_default.sparse_surface.operators.data.meshes import mark_sharp

sys.path.insert(0, str(Path(__file__).parent))
import scenes

QUICK = {"ring": 4, "iterations": 8, "sweeps": 0, "workers": 1}


def sharp_edges(mesh):
    """Return the middles of the sharp edges, (E, 3)."""
    where = [[mesh.vertices[k].co for k in edge.vertices] for edge in mesh.edges if edge.use_edge_sharp]
    return np.array(where, dtype=float).reshape(-1, 2, 3).mean(axis=1)


def test_edges_are_marked_whichever_way_round_and_others_stay_as_they_are():
    sheet = scenes.creased_sheet(4).data
    edge, other = sheet.edges[3], sheet.edges[7]
    other.use_edge_sharp = True
    first, second = edge.vertices
    mark_sharp(sheet, np.array([[second, first], [0, 15]]))
    assert [k for k, each in enumerate(sheet.edges) if each.use_edge_sharp] == [3, 7]


@pytest.mark.parametrize("marked", [True, False])
def test_the_creases_of_a_cube(marked):
    vertices, faces = cube(8)
    source = scenes.mesh_object("Cube", vertices, faces.tolist())
    settings = bpy.context.scene.sparse_surface
    settings.mark_creases = marked
    settings.creases = "off"
    for name, value in QUICK.items():
        setattr(settings, name, value)
    bpy.ops.sparse_surface.approximate()
    found = sharp_edges(bpy.context.object.data)
    assert not len(sharp_edges(source.data))
    if not marked:
        assert not len(found)
        return
    half = np.abs(vertices).max()
    # an edge of the cube lies where two coordinates are at their largest
    at_crease = (np.isclose(np.abs(found), half, atol=0.1 * half).sum(axis=1) >= 2).mean()
    assert at_crease > 0.9
    assert len(found) > 0.7 * 12 * 8


def test_a_smooth_head_has_no_creases():
    settings = bpy.context.scene.sparse_surface
    settings.workers, settings.sweeps, settings.iterations = 1, 0, 2
    bpy.ops.mesh.primitive_monkey_add()
    bpy.context.object.modifiers.new("Subdivision", "SUBSURF").levels = 2
    bpy.ops.sparse_surface.approximate()
    result = bpy.context.object
    assert len(result.data.vertices) == 7958
    assert result["sparse_surface"]["creases"]["edges"] == 0


@pytest.mark.parametrize("marked", [11, 0])
def test_the_edges_that_a_user_marked_are_the_creases(marked):
    # A smooth sheet: the edges of its middle row are marked, and the modifier keeps them.
    axis = np.linspace(0.0, 1.0, 12)
    x, y = (part.ravel() for part in np.meshgrid(axis, axis))
    corner = (np.arange(11)[:, None] * 12 + np.arange(11)).ravel()
    faces = np.stack([corner, corner + 1, corner + 13, corner + 12], axis=1)
    source = scenes.mesh_object("Sheet", np.stack([x, y, 0.1 * np.sin(3.0 * x)], axis=1), faces.tolist())
    source.modifiers.new("Mirror", "MIRROR").merge_threshold = 1e-6
    middle = [e for e in source.data.edges if all(72 <= k < 84 for k in e.vertices)]
    for edge in middle[:marked]:
        edge.use_edge_sharp = True
    for name, value in {**QUICK, "creases": "marked"}.items():
        setattr(bpy.context.scene.sparse_surface, name, value)
    bpy.ops.sparse_surface.approximate()
    result = bpy.context.object
    report = result["sparse_surface"].to_dict()
    found = sharp_edges(result.data)
    assert len(found) == report["creases"]["edges"] == 2 * marked
    np.testing.assert_allclose(found[:, 1], 6.0 / 11.0, atol=0.02)
    assert ("no edge inside the mesh is marked" in report_text.one_line("Sheet", report)) == (not marked)

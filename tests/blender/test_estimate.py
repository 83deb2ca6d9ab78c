"""What the panel says of a run before it begins, compared with runs."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import pytest
from bl_ext.user_default.sparse_surface.benchmarks import generated_models
from bl_ext.user_default.sparse_surface.operators.data.meshes import sharp_turns
from bl_ext.user_default.sparse_surface.operators.run import estimate as estimates
from bl_ext.user_default.sparse_surface.operators.run.estimate import (
    coarse_meshes,
    estimate,
    estimate_cloud,
    estimate_meshes,
    seems_closed,
)
from bl_ext.user_default.sparse_surface.solver import Settings, approximate

sys.path.insert(0, str(Path(__file__).parent))
import scenes


def ico_sphere(subdivisions: int) -> bpy.types.Object:
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=subdivisions)
    return bpy.context.active_object


@pytest.mark.parametrize("ring", [1, 2, 3, 7])
@pytest.mark.parametrize(
    "kind", ["cube", "sphere 1", "sphere 2", "sphere 3", "sphere 4", "sheet 4", "sheet 8", "sheet 20"]
)
def test_patches_of_small_meshes(kind: str, ring: int) -> None:
    shape, _, size = kind.partition(" ")
    if shape == "cube":
        bpy.ops.mesh.primitive_cube_add()
        made = bpy.context.active_object
    else:
        made = ico_sphere(int(size)) if shape == "sphere" else scenes.creased_sheet(int(size))
    assert seems_closed(made, bpy.context) == (shape != "sheet")
    faces = [list(face.vertices) for face in made.data.polygons]
    # what creases add is tested below
    settings = Settings(ring=ring, iterations=0, sweeps=0, workers=1, creases="off")
    came = approximate(scenes.positions(made.data), faces, settings).report["patches"]
    said = estimate(len(made.data.vertices), settings, closed=shape != "sheet").patches
    assert abs(said - came) <= max(2, 0.25 * came), f"{said} said, {came} came"


def test_a_tolerance_may_ask_for_more() -> None:
    assert not estimate(1000, Settings()).at_least
    assert estimate(1000, Settings(tolerance=0.01)).at_least
    assert not estimate(1000, Settings(tolerance=0.01, denoise="only")).at_least


def test_the_estimate_of_several_meshes_is_their_sum() -> None:
    sheets = [scenes.creased_sheet(size, f"Sheet {size}") for size in (10, 20)]
    single = [estimate_meshes([sheet], bpy.context) for sheet in sheets]
    both = estimate_meshes(sheets, bpy.context)
    assert both.patches == sum(one.patches for one in single)
    assert both.seconds == pytest.approx(sum(one.seconds for one in single))


def test_coarse_meshes_are_known() -> None:
    bpy.ops.mesh.primitive_cube_add()
    cube, sheet = bpy.context.active_object, scenes.creased_sheet(20)
    assert coarse_meshes([cube, sheet], bpy.context) == [cube]
    cube.modifiers.new("Subdivision", "SUBSURF").levels = 2
    bpy.context.view_layer.update()
    assert coarse_meshes([cube, sheet], bpy.context) == []


def test_clouds_have_an_estimate_that_learns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimates, "_cloud_speed", 1.0)
    first = estimate_cloud(30_000)
    assert first.patches == 500
    assert estimate_cloud(30_000, 24).patches == 24
    assert estimate_cloud(30_000, 24).seconds < first.seconds
    estimates.learn({"seconds": {"total": 15.0}, "input": {"points": 30_000, "vertices": 500}})
    assert estimate_cloud(30_000, 500).seconds == pytest.approx(15.0)


def test_a_coarse_mesh_is_subdivided_by_the_button_and_keeps_its_shape() -> None:
    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.active_object
    scenes.hurry(use_modifiers=False)
    assert bpy.ops.sparse_surface.subdivide.poll()
    assert bpy.ops.sparse_surface.subdivide() == {"FINISHED"}
    assert bpy.context.scene.sparse_surface.use_modifiers
    assert len(cube.data.vertices) == 8
    split = scenes.world_positions(cube, evaluated=True)
    assert len(split) == 1538
    assert abs(abs(split).max(axis=1) - 1.0).max() < 1e-6  # on the cube's faces
    assert not bpy.ops.sparse_surface.subdivide.poll()
    assert bpy.ops.sparse_surface.approximate() == {"FINISHED"}
    assert bpy.context.object["sparse_surface"]["patches"] > 5


def test_points_are_counted_as_they_are_read() -> None:
    points = scenes.mesh_object("Scan", [(x / 10, y / 10, 0.0) for x in range(10) for y in range(10)], [])
    assert estimates.point_count(points, bpy.context) == 100
    points.modifiers.new("Array", "ARRAY").count = 3
    bpy.context.view_layer.update()
    assert estimates.point_count(points, bpy.context) == 300
    assert estimates.point_count(None, bpy.context) == 0


@pytest.mark.parametrize("name", ["cube", "cylinder", "cubetorus", "lens", "l_solid", "sphere"])
def test_patches_at_creases_are_counted(name: str) -> None:
    """The surface is cut along creases, and each side is covered by itself: twice as many patches on a solid."""
    vertices, faces = getattr(generated_models, name)()[:2]
    made = scenes.mesh_object(name, vertices, [list(map(int, face)) for face in faces])
    turns = sharp_turns(made.data, estimates.CREASE_DEGREES)
    came = approximate(vertices, faces, Settings(iterations=2, sweeps=0, workers=1)).report
    assert turns == came["creases"]["edges"]  # sharp ones; all are found
    said = estimate(len(vertices), Settings(), creases=turns).patches
    assert abs(said - came["patches"]) <= 0.25 * came["patches"], f"{said} said, {came['patches']} came"


def test_noise_is_not_taken_for_creases(monkeypatch) -> None:
    sheet = scenes.creased_sheet(20)
    for vertex in sheet.data.vertices:
        vertex.co.z += 0.2 * (vertex.index % 3)
    sheet.data.update()
    key = (sheet.session_uid, len(sheet.data.vertices), len(sheet.data.edges), len(sheet.data.polygons))
    monkeypatch.setitem(estimates._creases, key, -1)
    estimates._count_creases(sheet.session_uid, key)
    assert estimates._creases[key] == 0

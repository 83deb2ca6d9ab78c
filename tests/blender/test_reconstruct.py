"""Points to surfaces in Blender: the operator on both kinds of clouds, bases, refusals, and what is left behind."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface.benchmarks.generated_clouds import ball, hill, l_solid
from bl_ext.user_default.sparse_surface.solver import CloudSettings
from bl_ext.user_default.sparse_surface.solver.errors import InputError
from bl_ext.user_default.sparse_surface.solver.reconstruction.made_base import make_base
from mathutils import Euler, Matrix

sys.path.insert(0, str(Path(__file__).parent))
import scenes

COUNTED = ("objects", "meshes", "materials", "collections", "node_groups", "pointclouds")


@pytest.fixture(autouse=True)
def quick():
    """Settings that take a second, on an empty scene."""
    bpy.ops.wm.read_homefile(use_empty=True)
    settings = bpy.context.scene.sparse_surface
    settings.iterations, settings.workers = 3, 1
    settings.reconstruction.corrections = 1


def wanted() -> Any:
    return bpy.context.scene.sparse_surface.reconstruction


def counts() -> dict[str, int]:
    return {name: len(getattr(bpy.data, name, ())) for name in COUNTED}


def cloud_object(points: np.ndarray, name: str = "Scan") -> Any:
    return scenes.mesh_object(name, points, [])


def base_object(cloud: Any, name: str = "Coarse") -> Any:
    made = scenes.mesh_object(name, cloud.base_vertices, cloud.base_faces.tolist())
    wanted().base = made
    return made


def reconstruct(points: Any) -> Any:
    scenes.select(points)
    assert bpy.ops.sparse_surface.reconstruct() == {"FINISHED"}
    return bpy.context.active_object


def refused(points: Any, match: str) -> None:
    before = counts()
    scenes.select(points)
    with pytest.raises(RuntimeError, match=match):
        bpy.ops.sparse_surface.reconstruct()
    assert counts() == before


def volume(mesh: Any) -> float:
    mesh.calc_loop_triangles()
    points = scenes.positions(mesh).astype(float)
    corners = np.array([t.vertices for t in mesh.loop_triangles])
    a, b, c = (points[corners[:, k]] for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6.0)


def border_edges(mesh: Any) -> int:
    uses = np.zeros(len(mesh.edges), dtype=int)
    for loop in mesh.loops:
        uses[loop.edge_index] += 1
    assert uses.max() == 2
    return int((uses == 1).sum())


def test_loose_vertices_over_a_chosen_base():
    cloud = ball(700)
    points = cloud_object(cloud.points)
    base = base_object(cloud)
    before = scenes.positions(points.data)
    made = reconstruct(points)
    assert made.name == "Scan Sparse Surface" == made.data.name
    assert sorted(o.name for o in bpy.data.objects) == ["Coarse", "Scan", "Scan Point Errors", "Scan Sparse Surface"]
    assert list(bpy.context.selected_objects) == [made]
    surface = scenes.positions(made.data).astype(float)
    assert 350 < len(surface) < 1400, "about as many vertices as points"
    assert cloud.distance(surface).max() < 5e-3
    assert border_edges(made.data) == 0
    assert volume(made.data) == pytest.approx(np.pi / 6, rel=0.01)
    assert np.array_equal(scenes.positions(points.data), before)
    assert len(base.data.vertices) == 24


def test_result_carries_errors_colours_patches_and_the_report():
    cloud = ball(500, noise=0.003)
    points = cloud_object(cloud.points)
    base_object(cloud)
    made = reconstruct(points)
    report = made["sparse_surface"].to_dict()
    assert report["input"]["points"] == 500
    assert report["flipped_triangles"] == 0
    assert report["normal_error_degrees"] < 45.0
    patch = scenes.values(made.data, "patch")
    assert set(np.unique(patch)) == set(range(report["patches"]))
    assert scenes.values(made.data, "domain_stretch").min() >= 1.0
    on_points = bpy.data.objects["Scan Point Errors"]
    assert len(on_points.data.polygons) == 0
    assert np.array_equal(scenes.positions(on_points.data), scenes.positions(points.data))
    error = scenes.values(on_points.data, "error")
    assert np.sqrt((error.astype(float) ** 2).mean()) == pytest.approx(report["surface_error"]["rms"], rel=1e-4)
    assert np.all(scenes.values(on_points.data, "weight") == 1.0)
    for shown in (made, on_points):
        assert shown.data.color_attributes.active_color.name == "error_color"
        assert list(shown["error_color_range"]) == pytest.approx([0.0, float(error.max()), 0.0], rel=1e-5)
    assert 0.0 < scenes.values(made.data, "error").max() <= error.max()


def test_point_cloud_object():
    if "POINTCLOUD" not in bpy.ops.object.convert.get_rna_type().properties["target"].enum_items:
        pytest.skip("this Blender makes no point clouds")
    cloud = ball(400)
    cloud_object(cloud.points)
    bpy.ops.object.convert(target="POINTCLOUD")
    points = bpy.context.active_object
    assert points.type == "POINTCLOUD"
    base_object(cloud)
    made = reconstruct(points)
    assert cloud.distance(scenes.positions(made.data).astype(float)).max() < 0.01


def test_without_a_base_one_is_made_and_kept_if_asked():
    cloud = ball(600, noise=0.002)
    wanted().base_vertices, wanted().keep_base, wanted().point_errors = 40, True, False
    made = reconstruct(cloud_object(cloud.points))
    base = bpy.data.objects["Scan Base"]
    assert 30 <= len(base.data.vertices) <= 50
    assert border_edges(base.data) == 0
    assert volume(base.data) > 0.3
    assert sorted(o.name for o in bpy.data.objects) == ["Scan", "Scan Base", "Scan Sparse Surface"]
    assert len(bpy.data.node_groups) == 0
    assert np.sqrt((cloud.distance(scenes.positions(made.data).astype(float)) ** 2).mean()) < 0.01
    assert made["sparse_surface"]["input"]["vertices"] == len(base.data.vertices)


def test_points_and_base_may_be_moved_turned_and_scaled():
    cloud = ball(500)
    placed = Matrix.LocRotScale((3.0, -1.0, 2.0), Euler((0.3, 0.8, -0.5)), (2.0, 2.0, 2.0))
    points, base = cloud_object(cloud.points), base_object(cloud)
    other = Matrix.LocRotScale((0.0, 5.0, 0.0), Euler((0.0, 0.0, 1.0)), (0.5, 0.25, 1.0))
    base.data.transform(other.inverted() @ placed)
    points.matrix_world, base.matrix_world = placed, other
    bpy.context.view_layer.update()
    made = reconstruct(points)
    local = scenes.world_positions(made) @ np.linalg.inv(np.array(placed)).T[:3, :3]
    centre = np.array(placed.inverted() @ placed.translation)
    assert np.allclose(np.array(made.matrix_world), np.array(placed), atol=1e-6)
    assert cloud.distance(scenes.positions(made.data).astype(float)).max() < 0.01
    assert np.isfinite(local).all()
    assert np.allclose(centre, 0.0, atol=1e-5)
    assert made["sparse_surface"]["input"]["bounding_box_longest_side"] == pytest.approx(2.0, rel=0.05)


def test_resolution_and_resampling():
    cloud = ball(400)
    points = cloud_object(cloud.points)
    base_object(cloud)
    wanted().splits = 3
    made = reconstruct(points)
    assert len(made.data.polygons) == 9 * len(cloud.base_faces)
    assert bpy.ops.sparse_surface.resample(splits=6) == {"FINISHED"}
    finer = bpy.context.active_object
    assert len(finer.data.polygons) == 36 * len(cloud.base_faces)
    assert cloud.distance(scenes.positions(finer.data).astype(float)).max() < 0.01
    assert scenes.values(finer.data, "error").max() <= scenes.values(made.data, "error").max()
    scenes.select(made)
    made.data.vertices[0].co.x += 0.5
    with pytest.raises(RuntimeError, match="was edited"):
        bpy.ops.sparse_surface.resample(splits=2)


def test_the_tools_for_representations_work_on_reconstructed_surfaces():
    cloud = ball(300)
    points = cloud_object(cloud.points)
    base_object(cloud)
    wanted().splits = 2
    made = reconstruct(points)
    assert bpy.ops.sparse_surface.show_patches() == {"FINISHED"}
    assert bpy.ops.sparse_surface.inspect_patch() == {"FINISHED"}
    scenes.select(made)
    assert bpy.ops.sparse_surface.separate_patches() == {"FINISHED"}
    patches = bpy.data.collections["Scan Sparse Surface Patches"].objects
    assert len(patches) == made["sparse_surface"]["patches"]
    assert cloud.distance(scenes.positions(patches[0].data).astype(float)).max() < 0.05
    scenes.select(made)
    with pytest.raises(RuntimeError, match="finer than its domains"):
        bpy.ops.sparse_surface.domains_to_uv()
    wanted().splits = 1
    made = reconstruct(points)
    assert bpy.ops.sparse_surface.domains_to_uv() == {"FINISHED"}
    assert len(made.data.uv_layers) == 2


def test_settings_are_the_solvers():
    settings = wanted()
    settings.property_unset("corrections")
    assert settings.to_cloud_settings() == CloudSettings()
    for item in dataclasses.fields(CloudSettings):
        drawn = settings.bl_rna.properties[item.name]
        assert drawn.description == item.metadata["text"]
        if not isinstance(item.default, (bool, str)):
            assert (drawn.hard_min, drawn.hard_max) == pytest.approx((item.metadata["low"], item.metadata["high"]))


def test_again_replaces_the_earlier_result():
    cloud = ball(300)
    points = cloud_object(cloud.points)
    base_object(cloud)
    first = reconstruct(points)
    before = counts()
    assert reconstruct(points) == first
    assert counts() == before
    bpy.context.scene.sparse_surface.replace_result = False
    assert reconstruct(points) != first


def test_outliers_weigh_nothing():
    cloud = ball(700, noise=0.002)
    stray = np.random.default_rng(5).uniform(-0.6, 0.6, size=(30, 3))
    points = cloud_object(np.concatenate([cloud.points, stray]))
    base_object(cloud)
    wanted().robust = "tukey"
    reconstruct(points)
    weight = scenes.values(bpy.data.objects["Scan Point Errors"].data, "weight")
    assert weight[:700].mean() > 0.8
    assert weight[700:].mean() < 0.3


def test_same_scene_same_bytes():
    cloud = l_solid(1200)
    wanted().point_errors = False
    one = reconstruct(cloud_object(cloud.points, "One"))
    two = reconstruct(cloud_object(cloud.points, "Two"))
    assert scenes.positions(one.data).tobytes() == scenes.positions(two.data).tobytes()


def test_closed_clouds_get_closed_bases_wound_outwards():
    for cloud in (ball(200), ball(1500, noise=0.005), l_solid(3000)):
        base = make_base(cloud.points, 60)
        assert base.closed
        sides = np.sort(np.stack([base.triangles, np.roll(base.triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        assert np.all(np.unique(sides, axis=0, return_counts=True)[1] == 2)
        a, b, c = (base.vertices[base.triangles[:, k]] for k in range(3))
        assert (a * np.cross(b, c)).sum() > 0.0
        assert len(base.vertices) <= 62
        assert np.median(cloud.distance(base.vertices)) < 0.08


def test_open_clouds_get_open_bases():
    cloud = hill(3000)
    base = make_base(cloud.points + np.array([10.0, 0.0, 0.0]))
    assert not base.closed
    a, b, c = (base.vertices[base.triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert 0.8 < area < 1.6, "one side of it, not both"
    assert np.abs(base.vertices[:, :2] - [10.0, 0.0]).max() < 0.56


@pytest.mark.parametrize(
    ("points", "match"),
    [
        (np.eye(3), "A surface needs at least 4 points; there are 3"),
        (np.zeros((0, 3)), "A surface needs at least 4 points; there are 0"),
        (np.random.default_rng(0).normal(size=(50, 3)) * [1, 1, 0], "All the points lie in one plane: choose a base"),
        (np.random.default_rng(0).normal(size=(50, 3)) * [1, 0, 0], "All the points lie on one line: choose a base"),
        (np.full((9, 3), 2.0), "All the points are at one place"),
        (
            np.array([[0, 0, 0], [1, 0, 0], [0, np.nan, 0], [0, 0, 1.0]]),
            "at least 4 points; of 4 only 3 can be used",
        ),
    ],
    ids=["three", "none", "plane", "line", "one place", "nan"],
)
def test_refused_points_leave_nothing_behind(points, match):
    refused(cloud_object(points), match)


def test_refused_bases_leave_nothing_behind():
    cloud = ball(200)
    points, base = cloud_object(cloud.points), base_object(cloud)
    base.location.x = 5.0
    refused(points, "The base is far from the points")
    base.location.x = 0.0
    wanted().base = scenes.mesh_object("Empty", cloud.base_vertices, [])
    refused(points, "The base 'Empty' has no faces")
    book = [[0, 1, 2], [1, 0, 3], [0, 1, 4]]
    wanted().base = scenes.mesh_object("Book", cloud.base_vertices, book)
    refused(points, "The base is not manifold")


def test_button_says_why_it_cannot_be_pressed():
    scenes.select()
    assert not bpy.ops.sparse_surface.reconstruct.poll()
    cloud = ball(100)
    base = base_object(cloud)
    scenes.select(base)
    assert not bpy.ops.sparse_surface.reconstruct.poll(), "the base is not its own cloud"
    points = cloud_object(cloud.points)
    scenes.select(base, points)
    assert bpy.ops.sparse_surface.reconstruct.poll()


def test_unable_base_is_made_again_with_the_same_settings_after_a_refusal():
    """A failed attempt must not leave modifiers, node groups or hidden objects that change the next one."""
    flat = cloud_object(np.random.default_rng(0).normal(size=(50, 3)) * [1, 1, 0], "Flat")
    refused(flat, "one plane")
    one = make_base(ball(300).points, 30)
    two = make_base(ball(300).points, 30)
    assert one.vertices.tobytes() == two.vertices.tobytes()
    with pytest.raises(InputError):
        make_base(np.zeros((10, 3)))

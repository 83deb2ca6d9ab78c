"""Pictures of reconstructions: the paper's three cases as generated clouds, and a solid without a base."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
from sparse_surface.benchmarks.generated_clouds import Cloud, airplane, ball, head, l_solid
from sparse_surface.operators.data import meshes as mesh_data
from sparse_surface.operators.data.colours import ColourScale
from sparse_surface.operators.data.points import read_cloud
from sparse_surface.operators.data.results import create_surface
from sparse_surface.operators.heat_map.picture import render_heatmap
from sparse_surface.operators.heat_map.point_shapes import create_point_shapes
from sparse_surface.solver import CloudSettings, Settings, run_to_end
from sparse_surface.solver.interchange import CloudOutcome
from sparse_surface.solver.reconstruction.evaluated import reconstruct_arrays
from sparse_surface.solver.reconstruction.made_base import make_base

TOP_SHARE = 0.995
"""Share of the errors that the colours range over: a few points must not leave the rest in one colour."""


def _linked(name: str, mesh: bpy.types.Mesh) -> bpy.types.Object:
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    return made


def _objects(cloud: Cloud, name: str, own_base: bool) -> tuple[bpy.types.Object, bpy.types.Object | None]:
    """Points and base in an empty scene."""
    bpy.ops.wm.read_homefile(use_empty=True)
    none = np.zeros(0, dtype=np.int32)
    points = _linked(name, mesh_data.create_mesh(name, cloud.points, none, none))
    if not own_base:
        return points, None
    faces = cloud.base_faces
    sizes = np.full(len(faces), faces.shape[1], dtype=np.int32)
    return points, _linked("Base", mesh_data.create_mesh("Base", cloud.base_vertices, faces.ravel(), sizes))


def reconstructed(
    cloud: Cloud, name: str, own_base: bool = True
) -> tuple[bpy.types.Object, bpy.types.Object, CloudOutcome, ColourScale]:
    """Reconstruct a cloud; returns the points' shapes with their errors, the surface, and what they were made of."""
    points, base = _objects(cloud, name, own_base)
    bpy.context.view_layer.update()
    source = read_cloud(bpy.context, points, base, 0, CloudSettings(), 0)
    result = run_to_end(reconstruct_arrays(source.arrays, Settings(workers=1)))
    scale = ColourScale(0.0, float(np.quantile(result.point_error, TOP_SHARE)))
    surface = create_surface(bpy.context, source, result, scale)
    spacing = result.report["input"]["spacing"]
    shapes = create_point_shapes(f"{len(cloud.points):,} points", cloud.points, spacing, result.point_error, scale)
    bpy.context.scene.collection.objects.link(shapes)
    return shapes, surface, result, scale


def _picture(cloud: Callable[[], Cloud], name: str, title: str, own_base: bool = True) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        shapes, surface, _, _ = reconstructed(cloud(), name, own_base)
        render_heatmap(surface, path, source=shapes, title=title)

    make.__doc__ = f"Render {title} beside their surface with its errors."
    return make


def cloud_point_errors(path: Path) -> None:
    """Render the points of a noisy sphere in the colours of their errors beside the base that was made from them."""
    cloud = ball(noise=0.005)
    shapes, surface, result, _ = reconstructed(cloud, "Ball", own_base=False)
    base = make_base(cloud.points)
    sizes = np.full(len(base.triangles), 3, dtype=np.int32)
    flat = _linked("Base", mesh_data.create_mesh("Base", base.vertices, base.triangles.ravel(), sizes))
    shapes["sparse_surface"] = surface["sparse_surface"]
    title = f"a base of {result.report['input']['vertices']} vertices"
    render_heatmap(shapes, path, source=flat, title=title, caption="errors of its points")


CLOUD_FIGURES: dict[str, Callable[[Path], None]] = {
    "cloud_ball": _picture(ball, "Ball", "1,410 points over 24 vertices"),
    "cloud_airplane": _picture(airplane, "Airplane", "9,730 points over 154 vertices"),
    "cloud_head": _picture(head, "Head", "26,909 points over 428 vertices"),
    "cloud_l_solid": _picture(l_solid, "L", "10,000 points, no base given", own_base=False),
    "cloud_point_errors": cloud_point_errors,
}
"""Name of a picture in docs/pictures -> what makes it."""

"""Show what the extension does: approximate models with the real operator, leave files to look at in out/.

    python scripts/demo.py                a generated flower with creases, and Blender's Suzanne
    python scripts/demo.py MODEL          any mesh file that Blender reads

For each mesh there are, in out/: NAME.blend (open it in Blender: source and result side by side, error colours in the
viewport), NAME.ply (the result), NAME.png (the heat map) and NAME.json (the report).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import sparse_surface
from mathutils import Euler, Vector
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.operators.data.result_keys import read_report
from sparse_surface.operators.files.formats import up_axis
from sparse_surface.operators.files.meshes import read_meshes, write_meshes
from sparse_surface.operators.heat_map.picture import render_heatmap
from sparse_surface.solver.atomic_files import atomic_output
from sparse_surface.solver.errors import SparseSurfaceError

OUT = Path(__file__).resolve().parent.parent / "out"


def make_flower() -> list[Any]:
    """Return an extruded flower: smooth sides, sharp edges where petals meet and around both ends."""
    bpy.ops.wm.read_homefile(use_empty=True)
    vertices, faces = models.flower()
    mesh = bpy.data.meshes.new("Flower")
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    flower = bpy.data.objects.new("Flower", mesh)
    bpy.context.scene.collection.objects.link(flower)
    return [flower]


def make_suzanne() -> list[Any]:
    """Return Blender's monkey under a subdivision modifier: 7,958 vertices."""
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.mesh.primitive_monkey_add()
    suzanne = bpy.context.object
    suzanne.modifiers.new("Subdivision", "SUBSURF").levels = 2
    bpy.ops.object.shade_smooth()
    return [suzanne]


def approximate(sources: list[Any]) -> list[Any]:
    """Run the operator on these objects and return the results."""
    bpy.context.view_layer.update()
    for other in bpy.context.view_layer.objects:
        other.select_set(other in sources)
    bpy.context.view_layer.objects.active = sources[0]
    before = set(bpy.data.objects)
    bpy.ops.sparse_surface.approximate()  # refusals come as RuntimeError, in one sentence
    return sorted(set(bpy.data.objects) - before, key=lambda made: made.name)


def set_up_viewports(shown: list[Any]) -> None:
    """Have the saved file open with these objects in view and the error colours on them."""
    bpy.context.view_layer.update()
    for found in bpy.context.view_layer.objects:
        found.select_set(False)
    corners = np.array([found.matrix_world @ Vector(corner) for found in shown for corner in found.bound_box])
    low, high = corners.min(axis=0), corners.max(axis=0)
    for area in (area for screen in bpy.data.screens for area in screen.areas if area.type == "VIEW_3D"):
        space = area.spaces.active
        space.shading.type, space.shading.color_type = "SOLID", "VERTEX"
        view = space.region_3d
        view.view_rotation = Euler((np.radians(66.0), 0.0, np.radians(12.0))).to_quaternion()
        view.view_location, view.view_distance = (low + high) / 2, 1.3 * float(np.linalg.norm(high - low))


def write(name: str, source: Any, result: Any, up: str) -> dict[str, Any]:
    """Write the result's mesh, picture and report; returns the report."""
    report = read_report(result)
    assert report is not None
    write_meshes(OUT / f"{name}.ply", [result])
    with atomic_output(OUT / f"{name}.json") as draft:
        draft.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    render_heatmap(result, OUT / f"{name}.png", source=source, up=up)
    return report


def show(name: str, make: Callable[[], list[Any]], up: str = "Z") -> None:
    """Approximate what `make` brings into an empty scene and leave all files of it."""
    print(f"{name} ...", flush=True)
    start = time.perf_counter()
    sources = make()
    results = approximate(sources)
    for source in sources:
        for result in (made for made in results if made.name.startswith(source.name)):
            own = name if len(sources) == 1 else f"{name}_{bpy.path.clean_name(source.name)}"
            print_summary(own, write(own, source, result, up))
            result.location.x += 1.15 * result.dimensions.x
    set_up_viewports([*sources, *results])
    write_meshes(OUT / f"{name}.blend", results)
    print(f"  done in {time.perf_counter() - start:.1f} s\n", flush=True)


def print_summary(name: str, report: dict[str, Any]) -> None:
    counts, relative, seconds = report["input"], report["relative"], report["seconds"]
    print(
        f"  {counts['vertices']} vertices, {report['patches']} patches, {report['flipped_triangles']} flips\n"
        f"  vertex error   rms {relative['vertex_rms']:.2e}  max {relative['vertex_max']:.2e}  of the longest side\n"
        f"  surface error  rms {relative['surface_rms']:.2e}  max {relative['surface_max']:.2e}\n"
        f"  solved in {seconds['total']:.1f} s by {report['workers']} workers\n"
        f"  out/{name}.ply  out/{name}.png  out/{name}.json"
    )


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", nargs="?", type=Path, help="mesh file: .obj .ply .stl .blend .glb ...")
    model = parser.parse_args(arguments).model
    OUT.mkdir(exist_ok=True)
    sparse_surface.register()
    try:
        if model is not None:
            show(model.stem, lambda: read_meshes(model), up=up_axis(model))
        else:
            show("flower", make_flower)
            show("suzanne", make_suzanne)
    except (SparseSurfaceError, OSError, RuntimeError) as error:
        print(f"demo: {str(error).removeprefix('Error: ').strip()}", file=sys.stderr)
        return 1
    finally:
        sparse_surface.unregister()  # bpy does not end well with classes still registered
    return 0


if __name__ == "__main__":
    sys.exit(main())

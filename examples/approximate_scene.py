"""Approximate every mesh of a .blend file by the operator, and save the file under another name.

    blender --background scene.blend --python examples/approximate_scene.py -- --output approximated.blend
    python examples/approximate_scene.py scene.blend --output approximated.blend

The second needs Blender as a Python module (pip install bpy).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))
import extension


def main() -> None:
    parser = argparse.ArgumentParser(description="Approximate every mesh of a .blend file.")
    parser.add_argument("scene", nargs="?", type=Path, help="the file; under Blender, the one that is open")
    parser.add_argument("--output", required=True, type=Path, help="where the file with the results is saved")
    parser.add_argument("--ring", type=int, default=7, help="patch radius in edge rings")
    options = parser.parse_args(extension.arguments())
    extension.package()
    if options.scene:
        bpy.ops.wm.open_mainfile(filepath=str(options.scene.resolve()))
    select_meshes()
    bpy.context.scene.sparse_surface.ring = options.ring
    bpy.ops.sparse_surface.approximate()  # waits; a refusal is a RuntimeError with one sentence
    for result in bpy.context.selected_objects:
        report = result["sparse_surface"]
        print(f"{result.name}: {report['patches']} patches, largest surface error {report['surface_error']['max']:.3g}")
    bpy.ops.wm.save_as_mainfile(filepath=str(options.output.resolve()))


def select_meshes() -> None:
    """Select the meshes that can be seen, and make one of them active."""
    meshes = [each for each in bpy.context.view_layer.objects if each.type == "MESH" and each.visible_get()]
    if not meshes:
        raise SystemExit("The scene holds no mesh.")
    for each in bpy.context.view_layer.objects:
        each.select_set(each in meshes)
    bpy.context.view_layer.objects.active = meshes[0]


if __name__ == "__main__":
    main()

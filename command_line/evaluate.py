"""The command `evaluate`."""

from __future__ import annotations

import argparse

import bpy

from ..operators.data import meshes as mesh_data
from ..operators.files.meshes import write_meshes
from ..solver.progress import run_to_end
from ..solver.surface.representation import Representation
from ..solver.surface.resampling import resample_steps
from .console import console
from .progress import progress_display


def run(options: argparse.Namespace) -> None:
    """Evaluate the representation on its mesh with split edges and write that mesh."""
    representation = Representation.load(options.representation)
    name = options.representation.stem
    with progress_display(name) as show:
        resampled = run_to_end(resample_steps(representation, options.resample), show)
    bpy.ops.wm.read_homefile(use_empty=True)
    mesh = mesh_data.create_mesh(name, resampled.vertices, resampled.corners, resampled.sizes)
    mesh_data.mark_sharp(mesh, resampled.creases)
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    write_meshes(options.output, [made])
    console.say(f"{name}: {len(mesh.vertices)} vertices, {len(mesh.polygons)} faces", name)
    console.figures({"vertices": len(mesh.vertices), "faces": len(mesh.polygons)})

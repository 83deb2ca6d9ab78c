"""The command `inspect`."""

from __future__ import annotations

import argparse

import bpy
import numpy as np

from ..operators.data import meshes as mesh_data
from ..operators.files.meshes import write_meshes
from ..operators.representation.patch_sheets import lay_out_patch
from ..solver.surface.representation import Representation
from .listing import list_patches


def run(options: argparse.Namespace) -> None:
    """List one patch of the representation, or all, and write the one."""
    surface = Representation.load(options.representation)
    list_patches(surface, options.patch, options.report)
    if options.output is not None:
        _write_patch(options, surface)


def _write_patch(options: argparse.Namespace, surface: Representation) -> None:
    bpy.ops.wm.read_homefile(use_empty=True)
    name = options.representation.stem
    points = np.ascontiguousarray(surface.at_vertices(), dtype=np.float32)
    mesh = mesh_data.create_mesh(name, points, surface.face_corners, np.diff(surface.face_offsets))
    holder = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(holder)
    write_meshes(options.output, lay_out_patch(bpy.context, holder, surface, options.patch))

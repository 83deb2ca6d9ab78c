"""The command `inspect`."""

from __future__ import annotations

import argparse
from typing import Any

import bpy
import numpy as np

from ..operators.data import meshes as mesh_data
from ..operators.files.meshes import write_meshes
from ..operators.representation.patch_sheets import lay_out_patch
from ..solver.surface.inspection import patch_energy, patch_terms
from ..solver.surface.representation import Representation
from .outputs import write_json


def run(options: argparse.Namespace) -> None:
    """List one patch of the representation, or all, and write the one."""
    surface = Representation.load(options.representation)
    one = options.patch is not None
    listed = [_describe(surface, patch) for patch in ([options.patch] if one else range(surface.patches))]
    for patch in listed:
        energy = patch["energy"]
        fell = f", energy {energy[-1]:.3g} of the first iteration's" if energy else ""
        print(f"patch {patch['patch']}: {patch['vertices']} vertices, {len(patch['functions'])} functions{fell}")
        for function in patch["functions"] if one else ():
            amounts = " ".join(f"{amount:12.4e}" for amount in function["amounts"])
            print(f"  {function['name']:<16} {amounts}")
    if options.report is not None:
        write_json(options.report, listed[0] if one else listed)
    if options.output is not None:
        _write_patch(options, surface)


def _describe(surface: Representation, patch: int) -> dict[str, Any]:
    """Return number, vertices, functions with their amounts in x, y and z, and energies of a patch."""
    functions = [{"name": term.name, "amounts": list(term.amounts)} for term in patch_terms(surface, patch)]
    size = int(surface.vertex_offsets[patch + 1] - surface.vertex_offsets[patch])
    return {"patch": patch, "vertices": size, "functions": functions, "energy": patch_energy(surface, patch)}


def _write_patch(options: argparse.Namespace, surface: Representation) -> None:
    bpy.ops.wm.read_homefile(use_empty=True)
    name = options.representation.stem
    points = np.ascontiguousarray(surface.at_vertices(), dtype=np.float32)
    mesh = mesh_data.create_mesh(name, points, surface.face_corners, np.diff(surface.face_offsets))
    holder = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(holder)
    write_meshes(options.output, lay_out_patch(bpy.context, holder, surface, options.patch))

"""The object that shows a saved representation."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from bpy.types import Context, Object

from ...solver.surface.metrics import strongest_patch
from ...solver.surface.representation import Representation
from ..data.attributes import write
from ..data.meshes import create_mesh
from ..data.result_keys import PATCH, REPRESENTATION
from ..data.results import write_error
from ..heat_map.scale import colour_scale


def open_representation(path: Path, context: Context) -> Object:
    """Make an object of a saved representation: its mesh, with each vertex where the functions put it.

    Raises
    ------
    FileFormatError
        When the file is damaged or holds something else.
    OSError
        When it cannot be read.
    """
    stored = path.read_bytes()
    representation = Representation.from_bytes(stored, path.name)
    positions = representation.at_vertices()
    sizes = np.diff(representation.face_offsets)
    mesh = create_mesh(path.stem, positions, representation.face_corners, sizes)
    made = bpy.data.objects.new(path.stem, mesh)
    context.scene.collection.objects.link(made)
    error = np.linalg.norm(positions - representation.vertices, axis=1)
    write_error(made, error, colour_scale(context.scene, error))
    write(mesh, {PATCH: strongest_patch(representation)})
    made[REPRESENTATION] = stored
    return made

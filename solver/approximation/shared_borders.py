"""Which meshes are parts of one surface: those in one frame that share an open border (see `parts`)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import InputError
from ..mesh.edges import connected_parts
from ..mesh.input_checks import checked_faces, checked_vertices
from ..mesh.welding import find_copies
from ..settings import Settings
from .parts import Mesh, joined


def groups_of_parts(meshes: Sequence[Mesh], settings: Settings) -> list[list[int]]:
    """Return the numbers of meshes in one frame, those together that share an open border; each group ascends.

    What would be refused stands alone.
    """
    sound = [number for number, mesh in enumerate(meshes) if _is_sound(mesh)]
    alone = [[number] for number in range(len(meshes)) if number not in sound]
    if not settings.merge_vertices or len(sound) < 2:
        return [[number] for number in range(len(meshes))]
    found = _groups([meshes[number] for number in sound], settings.merge_distance)
    return sorted([*alone, *([sound[each] for each in group] for group in found)])


def _is_sound(mesh: Mesh) -> bool:
    try:
        checked_faces(mesh.polygons(), len(checked_vertices(mesh.vertices)))
    except InputError:
        return False
    return True


def _groups(meshes: Sequence[Mesh], distance: float) -> list[list[int]]:
    together = joined(meshes)
    try:
        weld = find_copies(together.vertices, together.triangles.astype(np.int64), distance)
    except InputError:  # the distance is too large: each will be refused by itself
        weld = None
    if weld is None:
        return [[number] for number in range(len(meshes))]
    owner = np.repeat(np.arange(len(meshes)), [len(mesh.vertices) for mesh in meshes])
    label = connected_parts(owner, owner[weld.first][weld.place], len(meshes))[1]
    return [np.flatnonzero(label == group).tolist() for group in range(int(label.max()) + 1)]

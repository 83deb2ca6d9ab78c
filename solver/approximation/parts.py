"""Meshes that are parts of one surface: what shares a border is approximated as one mesh and given back part by part.

Files cut a body into objects by material, layer or group.  Approximated one by one, the parts would come apart where
they met: each surface leaves its border by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Indices, offsets_of
from ..mesh.edges import connected_parts
from ..mesh.welding import automatic_distance, find_weld
from ..settings import Settings
from ..surface.representation import Representation
from .result import Approximation

Mesh = Any
"""Flat arrays of a polygon mesh: an `interchange.MeshArrays`."""


@dataclass(frozen=True, eq=False)
class Part:
    """Where one of several meshes is in the surface of all of them.

    Attributes
    ----------
    faces, corners
        The faces that are its own, and their corners.
    place
        Vertex of the surface that each of its vertices is, (V,).
    """

    faces: slice
    corners: slice
    place: Indices


def groups_of_parts(meshes: Sequence[Mesh], settings: Settings) -> list[list[int]]:
    """Return the numbers of meshes in one frame, those together that share an open border; each group ascends."""
    together = joined(meshes)
    points = together.vertices.astype(np.float64)
    weld = None
    if settings.merge_vertices and len(meshes) > 1 and len(points):
        triangles = together.triangles.astype(np.int64)
        weld = find_weld(points, triangles, settings.merge_distance or automatic_distance(together.vertices, triangles))
    if weld is None:
        return [[number] for number in range(len(meshes))]
    owner = np.repeat(np.arange(len(meshes)), [len(mesh.vertices) for mesh in meshes])
    label = connected_parts(owner, owner[weld.first][weld.place], len(meshes))[1]
    return [np.flatnonzero(label == group).tolist() for group in range(int(label.max()) + 1)]


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """Return meshes as one; those without weights weigh 1."""
    vertices = offsets_of(np.array([len(mesh.vertices) for mesh in meshes], dtype=np.int64)).astype(np.int32)
    faces = offsets_of(np.array([len(mesh.sizes) for mesh in meshes], dtype=np.int64)).astype(np.int32)
    counted = list(zip(meshes, vertices, faces, strict=False))
    weights = [np.ones(len(each.vertices), np.float32) if each.weights is None else each.weights for each in meshes]
    sharp = [each.sharp_edges + start for each, start, _ in counted if each.sharp_edges is not None]
    return replace(
        meshes[0],
        vertices=np.concatenate([each.vertices for each in meshes]),
        corners=np.concatenate([each.corners + start for each, start, _ in counted]),
        sizes=np.concatenate([each.sizes for each in meshes]),
        triangles=np.concatenate([each.triangles + start for each, start, _ in counted]),
        triangle_polygons=np.concatenate([each.triangle_polygons + start for each, _, start in counted]),
        weights=None if all(each.weights is None for each in meshes) else np.concatenate(weights),
        sharp_edges=np.concatenate(sharp) if sharp else None,
    )


def taken_apart(whole: Approximation, meshes: Sequence[Mesh]) -> list[tuple[Approximation, Part]]:
    """Return the result of each of the meshes that were `joined`, all with the report and the surface of the whole."""
    counts = np.array([[len(mesh.vertices), len(mesh.sizes), len(mesh.corners)] for mesh in meshes])
    ends = np.cumsum(counts, axis=0)
    place = _places(joined(meshes), whole.representation)
    found = []
    for first, end in zip(ends - counts, ends, strict=True):
        vertices, faces, corners = (slice(int(a), int(b)) for a, b in zip(first, end, strict=True))
        own = replace(
            whole,
            vertices=whole.vertices[vertices],
            error=whole.error[vertices],
            patch=whole.patch[vertices],
            domain_stretch=whole.domain_stretch[faces],
            history=None if whole.history is None else whole.history[:, vertices],
            creases=None if whole.creases is None else _within(whole.creases, vertices),
        )
        found.append((own, Part(faces, corners, place[vertices])))
    return found


def _places(mesh: Mesh, surface: Representation) -> Indices:
    """Vertex of the surface that each vertex of the mesh is, (V,); those without faces keep their order."""
    place = np.full(len(mesh.vertices), -1, dtype=np.int64)
    place[mesh.corners] = surface.face_corners
    place[place < 0] = np.setdiff1d(np.arange(len(surface.vertices)), surface.face_corners)
    return place


def _within(pairs: Indices, vertices: slice) -> NDArray[np.int64]:
    inside = ((pairs >= vertices.start) & (pairs < vertices.stop)).all(axis=1)
    found: NDArray[np.int64] = pairs[inside] - vertices.start
    return found

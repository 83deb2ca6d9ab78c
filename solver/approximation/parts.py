"""Meshes that are parts of one surface: what shares a border is approximated as one mesh and given back part by part.

Files cut a body into objects by material, layer or group.  Approximated one by one, the parts would come apart where
they met: each surface leaves its border by itself.  Which parts share a border, `shared_borders` finds; who only shows
results need not load SciPy, so this module does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Indices, offsets_of
from .result import Approximation

if TYPE_CHECKING:
    from ..surface.representation import Representation

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
        triangulation=(
            np.concatenate([each.triangles + start for each, start, _ in counted]),
            np.concatenate([each.triangle_polygons + start for each, _, start in counted]),
        ),
        weights=None if all(each.weights is None for each in meshes) else np.concatenate(weights),
        sharp_edges=np.concatenate(sharp) if sharp else None,
    )


def taken_apart(whole: Approximation, meshes: Sequence[Mesh], names: Sequence[str]) -> list[Approximation]:
    """Return the result of each of the meshes that were `joined`, all with the surface of the whole.

    Their report is that of the whole, too; `input` in it has the `parts`, their names.
    """
    found = []
    report = replace(whole.measures, input={**whole.measures.input, "parts": list(names)})
    for vertices, faces, _ in _slices(meshes):
        own = replace(
            whole,
            measures=report,
            vertices=whole.vertices[vertices],
            error=whole.error[vertices],
            patch=whole.patch[vertices],
            domain_stretch=whole.domain_stretch[faces],
            history=None if whole.history is None else whole.history[:, vertices],
            creases=None if whole.creases is None else _within(whole.creases, vertices),
        )
        found.append(own)
    return found


def places_of_parts(surface: Representation, meshes: Sequence[Mesh]) -> list[Part]:
    """Return where each of the meshes that were `joined` is in the surface of all."""
    place = _places(joined(meshes), surface)
    return [Part(faces, corners, place[vertices]) for vertices, faces, corners in _slices(meshes)]


def _slices(meshes: Sequence[Mesh]) -> list[tuple[slice, slice, slice]]:
    """Return which vertices, faces and corners of the joined mesh are those of each."""
    counts = np.array([[len(mesh.vertices), len(mesh.sizes), len(mesh.corners)] for mesh in meshes])
    ends = np.cumsum(counts, axis=0)
    pairs = zip((ends - counts).tolist(), ends.tolist(), strict=True)
    return [(slice(v, w), slice(f, g), slice(c, d)) for (v, f, c), (w, g, d) in pairs]


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

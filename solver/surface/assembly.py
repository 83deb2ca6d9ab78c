"""Putting fitted patches together to a representation."""

from __future__ import annotations

import numpy as np

from ..arrays import Array, padded_rows
from ..fitting.chunks import PatchFit
from ..mesh.triangle_mesh import TriangleMesh
from ..patches.patches import Patches
from ..settings import Settings
from .closing import Fans
from .representation import Representation


def assemble(
    mesh: TriangleMesh, patches: Patches, weights: Array, fits: list[PatchFit], settings: Settings
) -> Representation:
    """Put the fitted patches together."""
    channels, frames = settings.channels, [frame for fit in fits for frame in fit.frames]

    def joined(arrays: list[Array]) -> Array:
        return np.concatenate(arrays, axis=1) if arrays else np.zeros((channels, 0, 2))

    made = Representation(
        vertices=mesh.vertices,
        triangles=mesh.triangles,
        polygon=mesh.polygon,
        face_offsets=mesh.face_offsets,
        face_corners=mesh.face_corners,
        vertex_offsets=patches.vertex_offsets,
        patch_vertices=patches.vertices,
        triangle_offsets=patches.triangle_offsets,
        patch_triangles=patches.triangles,
        mesh_triangles=patches.mesh_triangles,
        domains=joined([fit.domain for fit in fits]),
        initial_domains=joined([fit.initial_domain for fit in fits]),
        weights=weights,
        blending=settings.blending,
        origins=np.concatenate([np.zeros(0), *(frame.origin for frame in frames)]).reshape(-1, 3),
        scales=np.array([frame.scale for frame in frames], dtype=np.float64).reshape(-1, channels),
        basis=settings.basis,
        degree=settings.degree,
        support=padded_rows([fit.support for fit in fits], -1, (3,), np.int64),
        coefficients=padded_rows([fit.coefficients for fit in fits], 0.0, (3,)),
        energy=padded_rows([fit.energy for fit in fits], np.nan),
        solver=settings.solver,
        # maps of flat sides have no axes of their own, by which they could be made again
        initial=settings.initial_domain,
        creases=mesh.creases,
    )
    if (fans := Fans.of_mesh(mesh)) is not None:
        made.take_cover({"fans": fans})
    return made

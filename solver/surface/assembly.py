"""Putting fitted patches together to a representation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..fitting.chunks import PatchFit
from ..mesh.triangle_mesh import TriangleMesh
from ..patches.patches import Patches
from ..settings import Settings
from .representation import Representation


def assemble(
    mesh: TriangleMesh, patches: Patches, weights: Array, fits: list[PatchFit], settings: Settings
) -> Representation:
    """Put the fitted patches together."""
    channels = settings.channels
    sparsity = max((fit.support.shape[1] for fit in fits), default=0)
    iterations = max((len(fit.energy) for fit in fits), default=0)

    def joined(arrays: list[Array]) -> Array:
        return np.concatenate(arrays, axis=1) if arrays else np.zeros((channels, 0, 2))

    def padded(arrays: list[NDArray[Any]], shape: tuple[int, ...], filler: float) -> NDArray[Any]:
        wide = np.full((len(arrays), *shape), filler, dtype=arrays[0].dtype if arrays else np.float64)
        for row, array in zip(wide, arrays, strict=True):
            row[..., : array.shape[-1]] = array
        return wide

    return Representation(
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
        origins=np.array([np.concatenate([f.origin for f in fit.frames]) for fit in fits]).reshape(-1, 3),
        scales=np.array([[f.scale for f in fit.frames] for fit in fits]).reshape(-1, channels),
        basis=settings.basis,
        degree=settings.degree,
        support=padded([fit.support for fit in fits], (3, sparsity), -1).astype(np.int64),
        coefficients=padded([fit.coefficients for fit in fits], (3, sparsity), 0.0),
        energy=padded([fit.energy for fit in fits], (iterations,), np.nan),
        solver=settings.solver,
        # maps of flat sides have no axes of their own, by which they could be made again
        initial=settings.initial_domain,
        creases=mesh.creases,
    )

"""What the patches are fitted to: observed points, each somewhere in the triangles of the mesh.

For a mesh these are its vertices and the centroids of its triangles; for a point cloud over a base mesh, the projected
points.  Everything that fits patches or makes them agree sees observations only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .mesh import TriangleMesh
from .patches import Patches

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

ANY_DEGREE = 30
SMALL_PATCH = 100
SMALL_PATCH_DEGREE = 7
CENTROID_WEIGHT = 0.5
SMALL_PATCH_CENTROID_WEIGHT = 1.5
"""Small patches have too few vertices to hold a high degree between them."""


@dataclass(frozen=True)
class PatchObservations:
    """The N observations of one patch.

    Attributes
    ----------
    number
        Which of all observations these are, (N,).
    corners, shares
        The patch's vertices that each lies between, and its barycentric coordinates, (N, 3) both.
    weights
        Weights of the observations before blending is considered, (N,).
    blending
        Blending weight of the patch at each of them, phi, (N,).
    degree
        Highest total degree that so many observations can hold.
    """

    number: Indices
    corners: Indices
    shares: Array
    weights: Array
    blending: Array
    degree: int


class Observations(Protocol):
    """All observations, and which of them each patch has.

    Attributes
    ----------
    patches
        The cover.
    vertices
        Vertices of the mesh, (V, 3), scene units.
    points
        The observed points, (O, 3), scene units.
    """

    patches: Patches
    vertices: Array
    points: Array

    def of_patch(self, patch: int) -> PatchObservations:
        """Observations of one patch."""
        ...


class MeshObservations:
    """The vertices of a mesh, then the centroids of its triangles.

    Without the centroids the surface would oscillate between the vertices.
    """

    def __init__(self, mesh: TriangleMesh, patches: Patches, weights: Array, kind: str) -> None:
        """Take a cover with its blending weights (M,) of a kind, "partition" or "uniform"."""
        self.patches, self.vertices = patches, mesh.vertices
        self.points = np.concatenate([mesh.vertices, mesh.vertices[mesh.triangles].mean(axis=1)])
        self._vertex_weights = weights
        overlap = np.bincount(patches.mesh_triangles, minlength=len(mesh.triangles))
        self._overlap = overlap if kind == "uniform" else None

    def of_patch(self, patch: int) -> PatchObservations:
        """Observations of one patch: its vertices, then the centroids of its triangles."""
        vertices = slice(*self.patches.vertex_offsets[patch : patch + 2])
        faces = slice(*self.patches.triangle_offsets[patch : patch + 2])
        triangles, mesh_triangles = self.patches.triangles[faces], self.patches.mesh_triangles[faces]
        count = vertices.stop - vertices.start
        small = count < SMALL_PATCH
        centroid_weight = SMALL_PATCH_CENTROID_WEIGHT if small else CENTROID_WEIGHT
        at_vertices = self._vertex_weights[vertices]
        inside = at_vertices[triangles].mean(axis=1) if self._overlap is None else 1.0 / self._overlap[mesh_triangles]
        return PatchObservations(
            np.concatenate([self.patches.vertices[vertices], len(self.vertices) + mesh_triangles]),
            np.concatenate([np.repeat(np.arange(count), 3).reshape(-1, 3), triangles]),
            np.concatenate([np.tile([1.0, 0.0, 0.0], (count, 1)), np.full((len(triangles), 3), 1.0 / 3.0)]),
            np.concatenate([np.ones(count), np.full(len(triangles), centroid_weight)]),
            np.concatenate([at_vertices, inside]),
            SMALL_PATCH_DEGREE if small else ANY_DEGREE,
        )

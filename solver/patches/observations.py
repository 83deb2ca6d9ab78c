"""What the patches are fitted to: observed points, each somewhere in the triangles of the mesh.

For a mesh these are its vertices and the centroids of its triangles; for a point cloud over a base mesh, the projected
points.  Everything that fits patches or makes them agree sees observations only.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Booleans, Indices, has_masked
from ..errors import InputError
from ..mesh.sampling import CENTROID, SURFACE_SAMPLES
from ..mesh.triangle_mesh import TriangleMesh
from ..native.observations import Inside, Observed
from .patches import Patches

ANY_DEGREE = 30
SMALL_PATCH = 100
SMALL_PATCH_DEGREE = 7
CENTROID_WEIGHT = 0.5
SMALL_PATCH_INSIDE_WEIGHT = 1.5
"""Small patches have too few vertices to hold a high degree between them."""


def checked_weights(weights: ArrayLike | None, vertices: int) -> Array | None:
    """Return observation weights of the vertices, (V,), or None for ones.

    Raises
    ------
    InputError
        When they are not one number from 0 to 1 for each vertex.
    """
    if weights is None:
        return None
    try:
        checked = np.asarray(weights, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("The weights must be one number from 0 to 1 for each vertex.") from None
    if has_masked(weights):
        raise InputError("The weights are an array with masked values; fill them first.")
    if checked.shape != (vertices,) or not ((checked >= 0.0) & (checked <= 1.0)).all():
        raise InputError("The weights must be one number from 0 to 1 for each vertex.")
    return None if (checked == 1.0).all() else checked


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
        Highest total degree for this number of observations.
    noise
        Standard deviation of the observed points, scene units.
    ends_early
        Whether the patch lies at a crease: a smooth side, for which a good fit is found soon.
    """

    number: Indices
    corners: Indices
    shares: Array
    weights: Array
    blending: Array
    degree: int
    noise: float = 0.0
    ends_early: bool = False


def small_patch_degrees(observations: Indices) -> Indices:
    """Highest total degrees, at most 7, of which there are at least two observations for each polynomial, (K,)."""
    degree = np.arange(SMALL_PATCH_DEGREE + 1)
    return np.maximum(np.searchsorted((degree + 1) * (degree + 2), observations, side="right") - 1, 0)


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
    sizes
        Work that each patch means, as a number of observations, (K,).
    degrees
        Highest total degree that each patch may use, (K,).
    ends_early
        See `PatchObservations`, (K,).
    """

    patches: Patches
    vertices: Array
    points: Array
    sizes: Indices
    degrees: Indices
    ends_early: Booleans

    def of_patch(self, patch: int) -> PatchObservations:
        """Observations of one patch."""
        ...

    def blend_of(self, patch: int) -> tuple[Indices, Array]:
        """`number` and `blending` of one patch's observations, which are asked for more often than the rest."""
        ...

    def allowed_degrees(self, patches: Indices) -> Indices:
        """Highest total degrees of some patches' problems, (n,): no more than their observations allow."""
        ...

    def natively(self, domains: Array) -> Observed | None:
        """What the compiled kernel gathers from, with initial domains (M, 2); None: `of_patch` says all."""
        ...

    def with_degrees(self, degrees: Indices) -> Self:
        """Return the same observations with other degrees, (K,)."""
        ...


class MeshObservations:
    """The vertices of a mesh, once for each node, then the centroids of its triangles, then six points inside the
    triangles of small patches.

    Without points inside the triangles the surface would oscillate between the vertices; small patches, which have
    almost as many coefficients as vertices, need more of them.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        patches: Patches,
        blending: Array,
        kind: str,
        weights: Array | None = None,
        inside: bool = True,
        dense: Booleans | None = None,
        degrees: Indices | None = None,
    ) -> None:
        """Gather the observations.

        Parameters
        ----------
        mesh, patches
            The cover.
        blending
            Blending weights of the patches, (M,).
        kind
            "partition" or "uniform".
        weights
            Weights of the vertices themselves, (V,); ones where None.
        inside
            Whether points inside the triangles are observed; the paper observes vertices alone, with any degree.
        dense
            Patches that are observed as densely as small ones, (K,).
        degrees
            Highest total degree that each patch may use, (K,); any where None.
        """
        self._made_of = mesh, patches, blending, kind, weights, inside
        self.degrees = np.full(len(patches), ANY_DEGREE) if degrees is None else degrees
        self.patches, self.vertices = patches, mesh.vertices
        self.sizes = np.diff(patches.vertex_offsets) + np.diff(patches.triangle_offsets)
        self.blending = blending
        self._weights = weights
        self.ends_early = _at_creases(mesh, patches)
        self._blends: dict[int, tuple[Indices, Array]] = {}
        self._small = np.diff(patches.vertex_offsets) < SMALL_PATCH
        self._dense = self._small if dense is None else self._small | dense
        small = np.unique(patches.mesh_triangles[self._dense[patches.triangle_patch]])
        corners = mesh.vertices[mesh.triangles]
        dense = np.einsum("qk,tkd->tqd", SURFACE_SAMPLES, corners[small]).reshape(-1, 3)
        nodes = mesh.vertices[mesh.node_vertex]
        self.points = np.concatenate([nodes, corners.mean(axis=1), dense]) if inside else nodes
        self._first_centroid = len(nodes)
        self._inside = inside
        observed = np.diff(patches.vertex_offsets) + len(SURFACE_SAMPLES) * np.diff(patches.triangle_offsets)
        limited = self._small if inside else np.zeros(len(patches), dtype=bool)
        self._highest = np.where(limited, small_patch_degrees(observed), ANY_DEGREE)
        self._first_dense = np.full(len(mesh.triangles), -1, dtype=np.int64)
        self._first_dense[small] = len(nodes) + len(mesh.triangles) + 6 * np.arange(len(small))
        overlap = np.bincount(patches.mesh_triangles, minlength=len(mesh.triangles))
        self._overlap = overlap if kind == "uniform" else None

    def with_dense(self, more: Booleans) -> MeshObservations:
        """Return the observations with more of the patches, (K,), observed densely."""
        other = MeshObservations(*self._made_of, dense=self._dense | more, degrees=self.degrees)
        # vertices and centroids keep their numbers
        other._blends = {patch: blend for patch, blend in self._blends.items() if not other._dense[patch]}
        return other

    def with_degrees(self, degrees: Indices) -> MeshObservations:
        """Return the same observations with other degrees, (K,)."""
        other = copy(self)
        other.degrees = degrees
        return other

    def allowed_degrees(self, patches: Indices | int) -> Indices:
        """Highest total degrees of some patches' problems, (n,): no more than their observations allow."""
        return np.minimum(self.degrees[patches], self._highest[patches])

    def natively(self, domains: Array) -> Observed:
        """What the compiled kernel gathers from, with initial domains (M, 2)."""
        patches = self.patches
        first = self._first_centroid + np.arange(len(self._first_dense)), self._first_dense
        weights = CENTROID_WEIGHT, SMALL_PATCH_INSIDE_WEIGHT
        samples = (CENTROID, SURFACE_SAMPLES) if self._inside else (CENTROID[:0], SURFACE_SAMPLES[:0])
        inside = [
            Inside(shares, weight / (len(shares) or 1), numbers)
            for shares, weight, numbers in zip(samples, weights, first, strict=True)
        ]
        return Observed(
            patches.vertex_offsets,
            patches.vertices,
            patches.nodes,
            patches.triangle_offsets,
            patches.triangles,
            patches.mesh_triangles,
            self.vertices,
            self.points,
            domains,
            self.blending,
            self._weights,
            self._overlap,
            self._dense,
            (inside[0], inside[1]),
            partition=self._overlap is None,
        )

    def samples_of_patch(self, patch: int, triangles: Indices, samples: Array) -> tuple[PatchObservations, Array]:
        """Return places (q, 3) in some of a patch's triangles as observations, and where they are, (n q, 3)."""
        own = self.patches.triangle_offsets[patch] + triangles
        corners = np.repeat(self.patches.triangles[own], len(samples), axis=0)
        shares = np.tile(samples, (len(triangles), 1))
        first = self.patches.vertex_offsets[patch]
        blending = np.einsum("nk,nk->n", self.blending[first + corners], shares)
        points = np.einsum("nk,nkd->nd", shares, self.vertices[self.patches.vertices[first + corners]])
        none = np.full(len(corners), -1, dtype=np.int64)
        return PatchObservations(none, corners, shares, blending, blending, ANY_DEGREE), points

    def blend_of(self, patch: int) -> tuple[Indices, Array]:
        """`number` and `blending` of one patch's observations; computed once."""
        if patch not in self._blends:
            self.of_patch(patch)
        return self._blends[patch]

    def of_patch(self, patch: int) -> PatchObservations:
        """Observations of one patch: its vertices, then the points inside its triangles."""
        vertices = slice(*self.patches.vertex_offsets[patch : patch + 2])
        faces = slice(*self.patches.triangle_offsets[patch : patch + 2])
        triangles, mesh_triangles = self.patches.triangles[faces], self.patches.mesh_triangles[faces]
        count = vertices.stop - vertices.start
        dense = bool(self._dense[patch])
        samples = SURFACE_SAMPLES if dense else CENTROID
        samples = samples if self._inside else samples[:0]
        weight = SMALL_PATCH_INSIDE_WEIGHT if dense else CENTROID_WEIGHT
        inside = len(triangles) * len(samples)
        corners = np.empty((count + inside, 3), dtype=np.int64)
        corners[:count] = np.arange(count)[:, None]
        corners[count:].reshape(len(triangles), -1, 3)[:] = triangles[:, None]
        shares = np.zeros((len(corners), 3))
        shares[:count, 0] = 1.0
        shares[count:].reshape(len(triangles), -1, 3)[:] = samples
        own = np.concatenate([np.ones(count), np.full(inside, weight / (len(samples) or 1))])
        if self._weights is not None:
            own *= np.einsum("nk,nk->n", self._weights[self.patches.vertices[vertices]][corners], shares)
        if patch not in self._blends:
            blending = np.einsum("nk,nk->n", self.blending[vertices][corners], shares)
            if self._overlap is not None:
                blending[count:] = np.repeat(1.0 / self._overlap[mesh_triangles], len(samples))
            first = self._first_dense[mesh_triangles] if dense else self._first_centroid + mesh_triangles
            number = (first[:, None] + np.arange(len(samples))).ravel()
            self._blends[patch] = np.concatenate([self.patches.nodes[vertices], number]), blending
        number, blending = self._blends[patch]
        return PatchObservations(
            number,
            corners,
            shares,
            own,
            blending,
            int(self.allowed_degrees(patch)),
            ends_early=bool(self.ends_early[patch]),
        )


def _at_creases(mesh: TriangleMesh, patches: Patches) -> Booleans:
    """Which patches hold a side of a crease and are no refinement, (K,)."""
    split = np.zeros(len(mesh.vertices), dtype=bool)
    if len(mesh.creases):
        split[mesh.node_vertex[len(mesh.vertices) :]] = True
    at_crease = np.bincount(patches.vertex_patch, weights=split[patches.vertices], minlength=len(patches)) > 0
    return at_crease & (patches.levels == 0)

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

from ..arrays import Array, Booleans, Indices, any_of, has_masked, rows_at
from ..errors import InputError
from ..mesh.curved import offsets_inside
from ..mesh.fairing import fair_offsets
from ..mesh.potential_creases import beside_sharp_edges
from ..mesh.sampling import CENTROID, SURFACE_SAMPLES, middles_of, points_inside
from ..mesh.triangle_mesh import TriangleMesh
from ..native.observations import Inside, Observed
from .patches import Patches, corners_as_in_mesh

ANY_DEGREE = 30
SMALL_PATCH = 100
SMALL_FAIR_PATCH = 75
"""Patches with fewer vertices are observed densely; a fair surface that bends says more of what lies between."""
SMALL_PATCH_DEGREE = 7
CENTROID_WEIGHT = 0.5
SMOOTH_CENTROID_WEIGHT = 1.0
"""Of smooth patches, which miss the input by the sag of its triangles.  A weight of 1.5 would integrate the square of
that; less keeps vertices closer to the input.  Where a patch rounds a crease off, more than 1/2 would move it away."""
SHARP_DEGREES, FLAT_DEGREES = 60.0, 0.01
"""A patch is smooth, and it is flat, where its triangles make no larger angle than this."""
SMALL_PATCH_INSIDE_WEIGHT = 1.5
"""Small patches have too few vertices to hold a high degree between them."""
LIP_WEIGHT = 0.25
"""Weight of vertices on the side of a crease, where only half their triangles are and patches end."""


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
    triangles of smooth sides of creases and those of small patches.

    Without points inside the triangles the surface would oscillate between the vertices; small patches, which have
    almost as many coefficients as vertices, need more of them.

    Over a coarse curved mesh vertices lie outside a smooth surface and centroids inside.  At its end a polynomial can
    follow their rows in turn, and there its normals would be degrees off.  Six points of a triangle lie on both sides.

    Domains of their own for x, y and z could follow each flat triangle, and the surface would bend at every edge.  So
    there the points are observed on a fair surface beside the mesh (see `mesh.fairing`), and only flat sides end early:
    what is left of the error of others is that surface's.
    Refinements towards a tolerance are fitted to what the tolerance is measured from, the triangles themselves.

    Attributes
    ----------
    places
        Where the observed points lie on the mesh itself, (O, 3), scene units.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        patches: Patches,
        blending: Array,
        kind: str,
        weights: Array | None = None,
        inside: bool = True,
        curved: bool = False,
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
        curved
            Whether the smooth surface beside the mesh is observed.
        """
        self._made_of = mesh, patches, blending, kind, weights, inside, curved
        self.degrees = np.full(len(patches), ANY_DEGREE)
        self.patches, self.vertices = patches, mesh.vertices
        self.sizes = np.diff(patches.vertex_offsets) + np.diff(patches.triangle_offsets)
        self.blending, self._weights = blending, weights
        lips = _lips(mesh)
        bent = np.zeros(len(patches), dtype=bool)
        if curved:
            bent = _having(beside_sharp_edges(mesh, FLAT_DEGREES), patches) > 0
        self.ends_early = _at_creases(lips, patches) & ~bent
        self._corners = corners_as_in_mesh(mesh, patches)
        self._blends: dict[int, tuple[Indices, Array]] = {}
        self._small = self._dense = np.diff(patches.vertex_offsets) < np.where(bent, SMALL_FAIR_PATCH, SMALL_PATCH)
        self._inside = inside
        self._smooth = _having(sharp := beside_sharp_edges(mesh, SHARP_DEGREES), patches) == 0
        lips &= inside
        lips[mesh.nodes[sharp]] = False  # of noise, more than sag would be followed
        self._node_weights = np.where(lips, LIP_WEIGHT, 1.0)
        self._number_places(lips)
        observed = np.diff(patches.vertex_offsets) + len(SURFACE_SAMPLES) * np.diff(patches.triangle_offsets)
        limited = self._small if inside else np.zeros(len(patches), dtype=bool)
        self._highest = np.where(limited, small_patch_degrees(observed), ANY_DEGREE)
        overlap = np.bincount(patches.mesh_triangles, minlength=len(mesh.triangles))
        self._overlap = overlap if kind == "uniform" else None

    def _number_places(self, lips: Booleans) -> None:
        """Number all places: nodes, centroids, then those of triangles on smooth sides of creases, (N,), and of dense
        patches.
        """
        mesh = self._made_of[0]
        self._first_centroid = mesh.node_count
        self._first_dense = np.full(len(mesh.triangles), -1, dtype=np.int64)
        self._beside: Booleans = any_of(lips[mesh.nodes])
        self._curve = self._smooth_surface()
        self.places = self.points = rows_at(mesh.vertices, mesh.node_vertex)
        if not self._inside:
            return
        self.places = self.points = np.concatenate([self.places, middles_of(mesh.vertices, mesh.triangles)])
        if self._curve is not None:
            moves, bulges = self._curve
            within = offsets_inside(mesh.nodes, moves, bulges, CENTROID)[:, 0]
            self.points = self.places + np.concatenate([moves, within])
        self._observe_closely()

    def _observe_closely(self) -> None:
        """Number the places in triangles that get six of them, behind all others: those keep their numbers."""
        mesh, patches = self._made_of[:2]
        closely = self._beside.copy()
        closely[patches.mesh_triangles[self._dense[patches.triangle_patch]]] = True
        new = np.flatnonzero(closely & (self._first_dense < 0))
        self._first_dense[new] = len(self.places) + len(SURFACE_SAMPLES) * np.arange(len(new))
        places = points_inside(mesh.vertices, mesh.triangles[new], SURFACE_SAMPLES).reshape(-1, 3)
        if self._curve is None:
            self.places = self.points = np.concatenate([self.places, places])
            return
        moves, bulges = self._curve
        moved = offsets_inside(mesh.nodes[new], moves, bulges[new], SURFACE_SAMPLES).reshape(-1, 3)
        self.places = np.concatenate([self.places, places])
        self.points = np.concatenate([self.points, places + moved])

    def _smooth_surface(self) -> tuple[Array, Array] | None:
        """How far the smooth surface is away (see `fair_offsets`); None where the triangles are observed."""
        mesh, patches, *_, inside, curved = self._made_of
        if not (inside and curved) or patches.levels.any():
            return None
        moves, bulges = fair_offsets(mesh)
        moves[mesh.passed_through[mesh.node_vertex]] = 0.0
        return moves, bulges

    def with_dense(self, more: Booleans) -> MeshObservations:
        """Return the observations with more of the patches, (K,), observed densely; no place changes its number."""
        other = copy(self)
        other._dense = self._dense | more
        changed = other._dense & ~self._dense
        other._blends = {patch: blend for patch, blend in self._blends.items() if not changed[patch]}
        other._first_dense = self._first_dense.copy()
        if self._inside:
            other._observe_closely()
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
        samples = (CENTROID, SURFACE_SAMPLES) if self._inside else (CENTROID[:0], SURFACE_SAMPLES[:0])
        return Observed(
            patches.vertex_offsets,
            patches.vertices,
            patches.nodes,
            patches.triangle_offsets,
            patches.triangles,
            patches.mesh_triangles,
            self._corners,
            self.vertices,
            self.points,
            domains,
            self.blending,
            self._weights,
            self._overlap,
            self._dense,
            self._beside,
            self._node_weights,
            self._inside_weights,
            (Inside(samples[0], first[0]), Inside(samples[1], first[1])),
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

    @property
    def _inside_weights(self) -> Array:
        """Weight of all places inside a triangle together, (K,)."""
        weights = np.where(self._smooth, SMOOTH_CENTROID_WEIGHT, CENTROID_WEIGHT)
        return np.where(self._dense, SMALL_PATCH_INSIDE_WEIGHT, weights)

    def _places_inside(self, mesh_triangles: Indices, dense: bool) -> tuple[Indices, Array, Booleans]:
        """Places inside a patch's triangles: in which of them, (n,), where, (n, 3), and which are one of six, (n,)."""
        count, none = len(mesh_triangles), np.zeros(0, dtype=np.int64)
        if not self._inside:
            return none, np.zeros((0, 3)), none.astype(bool)
        closely = self._beside[mesh_triangles] | dense
        at = np.repeat(np.arange(count), np.where(closely, len(SURFACE_SAMPLES), 1))
        samples = CENTROID.repeat(len(at), axis=0)
        samples[closely[at]] = np.tile(SURFACE_SAMPLES, (int(closely.sum()), 1))
        return at, samples, closely[at]

    def blend_of(self, patch: int) -> tuple[Indices, Array]:
        """`number` and `blending` of one patch's observations; computed once."""
        if patch not in self._blends:
            self.of_patch(patch)
        return self._blends[patch]

    def of_patch(self, patch: int) -> PatchObservations:
        """Observations of one patch: its vertices, then the points inside its triangles."""
        vertices = slice(*self.patches.vertex_offsets[patch : patch + 2])
        faces = slice(*self.patches.triangle_offsets[patch : patch + 2])
        triangles, mesh_triangles = self._corners[faces], self.patches.mesh_triangles[faces]
        nodes, count = self.patches.nodes[vertices], vertices.stop - vertices.start
        at, samples, closely = self._places_inside(mesh_triangles, bool(self._dense[patch]))
        corners = np.concatenate([np.arange(count)[:, None].repeat(3, axis=1), triangles[at]])
        shares = np.zeros((len(corners), 3))
        shares[:count, 0] = 1.0
        shares[count:] = samples
        inside = self._inside_weights[patch] / np.where(closely, len(SURFACE_SAMPLES), 1)
        own = np.concatenate([self._node_weights[nodes], inside])
        if self._weights is not None:
            own *= np.einsum("nk,nk->n", self._weights[self.patches.vertices[vertices]][corners], shares)
        if patch not in self._blends:
            blending = np.einsum("nk,nk->n", self.blending[vertices][corners], shares)
            if self._overlap is not None:
                blending[count:] = 1.0 / self._overlap[mesh_triangles[at]]
            sixth, asked = np.arange(len(at)) - np.searchsorted(at, at), mesh_triangles[at]
            number = np.where(closely, self._first_dense[asked] + sixth, self._first_centroid + asked)
            self._blends[patch] = np.concatenate([nodes, number]), blending
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


def _lips(mesh: TriangleMesh) -> Booleans:
    """Which nodes lie on a side of a crease, (N,): those of vertices that a crease splits."""
    split = np.zeros(len(mesh.vertices), dtype=bool)
    if len(mesh.creases):
        split[mesh.node_vertex[len(mesh.vertices) :]] = True
    lips: Booleans = split[mesh.node_vertex]
    return lips


def _having(triangles: Booleans, patches: Patches) -> Indices:
    """How many of some triangles, (T,), each patch has, (K,)."""
    return np.bincount(patches.triangle_patch[triangles[patches.mesh_triangles]], minlength=len(patches))


def _at_creases(lips: Booleans, patches: Patches) -> Booleans:
    """Which patches hold a side of a crease and are not a refinement, (K,)."""
    held = np.bincount(patches.vertex_patch, weights=lips[patches.nodes], minlength=len(patches)) > 0
    at_crease: Booleans = held & (patches.levels == 0)
    return at_crease

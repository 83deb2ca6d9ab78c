"""Points over a base mesh as observations of the patches (section 5)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..arrays import Array, Indices, offsets_of, row_positions
from ..mesh.closest_points import Footpoints
from ..mesh.sampling import SURFACE_SAMPLES
from ..mesh.triangle_mesh import TriangleMesh
from ..patches.observations import PatchObservations
from ..patches.patches import Patches, corners_as_in_mesh
from ..settings import Settings
from .tangent_planes import TangentPlanes

POINTS_A_FUNCTION = 2.5
"""A patch may use the polynomials of total degree t when it has this many points for each of them."""

SCARCE = 4
"""A triangle with fewer observations gets fillers."""

FILLER_WEIGHT = 0.1
"""Weight of each of a triangle's six, beside that of a point."""

BORDER_SHARES = np.array([[5.0, 1.0], [3.0, 3.0], [1.0, 5.0]]) / 6.0
"""Places of an edge of the border that are held if no point is near, as shares of its ends."""

BORDER_SPACINGS, BORDER_WEIGHT = 0.5, 0.3
"""How near, in spacings, and their weight beside that of a point."""


@dataclass(frozen=True)
class ObservedCloud:
    """Observed points with their places on the base.

    Attributes
    ----------
    points
        (O, 3), scene units: the cloud first, then what was added to it.
    feet
        Where each lies on the base.
    weights
        (O,).
    noise
        Standard deviation of the points across the surface.
    held
        How many of the last observations keep their places on the base.
    """

    points: Array
    feet: Footpoints
    weights: Array
    noise: float
    held: int = 0

    def moved(self, feet: Footpoints, weights: Array) -> ObservedCloud:
        """The same points at other places of the base with other weights, or only the first of them."""
        count = min(len(weights), len(self.points) - self.held)
        triangle, barycentric = self.feet.triangle.copy(), self.feet.barycentric.copy()
        triangle[:count], barycentric[:count] = feet.triangle[:count], feet.barycentric[:count]
        return replace(
            self,
            feet=Footpoints(triangle, barycentric),
            weights=np.concatenate([weights[:count], self.weights[count:]]),
        )


def fillers(cloud: ObservedCloud, mesh: TriangleMesh) -> Footpoints:
    """Places in the triangles that have hardly any points: without an observation there the surface could oscillate."""
    weights = np.bincount(cloud.feet.triangle, weights=cloud.weights, minlength=len(mesh.triangles))
    scarce = np.flatnonzero(weights < SCARCE)
    return Footpoints(np.repeat(scarce, len(SURFACE_SAMPLES)), np.tile(SURFACE_SAMPLES, (len(scarce), 1)))


def filled(cloud: ObservedCloud, feet: Footpoints, points: Array, weight: float = FILLER_WEIGHT) -> ObservedCloud:
    """Add fillers at these places and points, with little weight."""
    return replace(
        cloud,
        points=np.concatenate([cloud.points, points]),
        feet=Footpoints(
            np.concatenate([cloud.feet.triangle, feet.triangle]),
            np.concatenate([cloud.feet.barycentric, feet.barycentric]),
        ),
        weights=np.concatenate([cloud.weights, np.full(len(points), weight)]),
    )


def held_at_border(cloud: ObservedCloud, mesh: TriangleMesh, planes: TangentPlanes, spacing: float) -> ObservedCloud:
    """Hold the surface near the base's border where no points are: it may run on along their planes, without end.

    Such a place of the border is observed on the nearest of the tangent planes around it.
    """
    edges = np.flatnonzero(mesh.edge_triangles[:, 1] < 0)
    triangle = mesh.edge_triangles[edges, 0]
    ends = (mesh.nodes[triangle][:, :, None] == mesh.edges[edges][:, None]).astype(np.float64)
    barycentric = np.einsum("eck,sk->esc", ends, BORDER_SHARES).reshape(-1, 3)
    places = Footpoints(np.repeat(triangle, len(BORDER_SHARES)), barycentric)
    on_base = places.on(mesh.vertices, mesh.triangles)
    feet = cloud.feet.on(mesh.vertices, mesh.triangles)
    alone = cKDTree(feet).query(on_base)[0] > BORDER_SPACINGS * spacing
    if not alone.any():
        return cloud
    alone_at = Footpoints(places.triangle[alone], places.barycentric[alone])
    held = filled(cloud, alone_at, planes.on_nearest(on_base[alone]), BORDER_WEIGHT)
    return replace(held, held=int(alone.sum()))


class CloudObservations:
    """Which of the observed points each patch has: those in its triangles.

    Attributes
    ----------
    patches, vertices, points, sizes, ends_early
        See `Observations`.
    degrees
        Highest total degree that each patch may use, (K,).
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        patches: Patches,
        blending: Array,
        kind: str,
        cloud: ObservedCloud,
        degrees: Indices | None = None,
    ) -> None:
        """Sort the points by triangle.

        Parameters
        ----------
        mesh, patches
            The base and its cover.
        blending, kind
            Blending weights of the patches, (M,), "partition" or "uniform".
        cloud
            What is observed.
        degrees
            The patches' degrees, (K,); where None, the highest that their points afford.
        """
        self._mesh, self._kind = mesh, kind
        self.patches, self.vertices, self.points = patches, mesh.vertices, cloud.points
        self.cloud, self._blending = cloud, blending
        self._order = np.argsort(cloud.feet.triangle, kind="stable")
        counts = np.bincount(cloud.feet.triangle, minlength=len(mesh.triangles))
        self._offsets = offsets_of(counts)
        self.sizes = _by_patch(patches, counts).astype(np.int64) + np.diff(patches.vertex_offsets)
        if degrees is None:
            weights = np.bincount(cloud.feet.triangle, weights=cloud.weights, minlength=len(mesh.triangles))
            degrees = affordable_degrees(_by_patch(patches, weights))
        self.degrees = degrees
        self.ends_early = np.zeros(len(patches), dtype=bool)
        self._blends: dict[int, tuple[Indices, Array]] = {}
        self._corners = corners_as_in_mesh(mesh, patches)
        overlap = np.bincount(patches.mesh_triangles, minlength=len(mesh.triangles))
        self._overlap = overlap if kind == "uniform" else None

    def with_degrees(self, degrees: Indices) -> CloudObservations:
        """Return the same observations with other degrees, (K,)."""
        return CloudObservations(self._mesh, self.patches, self._blending, self._kind, self.cloud, degrees)

    def of_cloud(self, cloud: ObservedCloud) -> CloudObservations:
        """Return observations of other points, or of the same at other places, with the same degrees."""
        return CloudObservations(self._mesh, self.patches, self._blending, self._kind, cloud, self.degrees)

    def of_patch(self, patch: int) -> PatchObservations:
        """Observations of one patch, triangle by triangle."""
        faces = slice(*self.patches.triangle_offsets[patch : patch + 2])
        triangles = self.patches.mesh_triangles[faces]
        places, offsets = row_positions(self._offsets, triangles)
        number = self._order[places]
        sizes = np.diff(offsets)
        corners = np.repeat(self._corners[faces], sizes, axis=0)
        shares = self.cloud.feet.barycentric[number]
        if self._overlap is None:
            own = self._blending[slice(*self.patches.vertex_offsets[patch : patch + 2])]
            blending = (own[corners] * shares).sum(axis=1)
        else:
            blending = np.repeat(1.0 / self._overlap[triangles], sizes)
        self._blends[patch] = number, blending
        weights = self.cloud.weights[number]
        return PatchObservations(number, corners, shares, weights, blending, int(self.degrees[patch]), self.cloud.noise)

    def allowed_degrees(self, patches: Indices) -> Indices:
        """Highest total degrees of some patches' problems, (n,)."""
        return self.degrees[patches]

    def natively(self, domains: Array) -> None:
        """The compiled kernel does not gather points over a base."""

    def blend_of(self, patch: int) -> tuple[Indices, Array]:
        """`number` and `blending` of one patch's observations."""
        if patch not in self._blends:
            self.of_patch(patch)
        return self._blends[patch]

    def samples_of_patch(self, patch: int, samples: Array) -> PatchObservations:
        """Observations at places (q, 3) in every triangle of a patch."""
        faces = slice(*self.patches.triangle_offsets[patch : patch + 2])
        own = self._blending[slice(*self.patches.vertex_offsets[patch : patch + 2])]
        corners = np.repeat(self._corners[faces], len(samples), axis=0)
        shares = np.tile(samples, (len(corners) // len(samples), 1))
        blending = (own[corners] * shares).sum(axis=1)
        none = np.full(len(corners), -1, dtype=np.int64)
        return PatchObservations(none, corners, shares, blending, blending, int(self.degrees[patch]))


def observer(
    mesh: TriangleMesh, settings: Settings, cloud: ObservedCloud
) -> Callable[[Patches, Array], CloudObservations]:
    """Return what makes observations of a cloud for patches with given blending weights, (M,)."""
    return lambda patches, blending: CloudObservations(mesh, patches, blending, settings.blending, cloud)


def affordable_degrees(points: Array) -> Indices:
    """Highest total degrees, at least 1, whose polynomials that many points, (K,), determine."""
    degrees = (np.sqrt(1.0 + 8.0 * points / POINTS_A_FUNCTION) - 3.0) / 2.0
    return np.maximum(degrees.astype(np.int64), 1)


def _by_patch(patches: Patches, of_triangles: NDArray[np.generic]) -> Array:
    """Sums over the patches' triangles, (K,), of values of the mesh's triangles, (T,)."""
    sums = np.bincount(patches.triangle_patch, weights=of_triangles[patches.mesh_triangles], minlength=len(patches))
    return sums.astype(np.float64)

"""How far noise pushes a fitted surface off the true one, found by adding the noise to the surface itself.

Each point observes the surface where that is nearest.  In noise as wide as a part is thick or as a bend is round, more
points lie outside of a surface than inside, and those that noise has carried through a thin part are taken for its
other side.  So the surface that is fitted bulges.  As the points came from the true surface, others are drawn from the
fitted one, with the same noise, and projected on it in the same way; what they are off on average is taken from what
the points observe (the parametric bootstrap, Efron 1979).  That of the true surface is then what is left of the points.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array, Indices
from ..mesh.closest_points import Footpoints, interpolate
from ..mesh.sampling import CENTROID, triangle_grid
from ..mesh.triangle_mesh import TriangleMesh
from ..surface.representation import Representation
from .correction import nearest_on_surface
from .observations import ObservedCloud

FINEST = 8
"""Most parts into which edges of the base are split for the places that a point may start from."""

INSIDE = 0.9
"""These lie this far from the middle of their triangle towards its sides, so that a step can leave it on any side."""

STEPS = 2
"""Steps towards the nearest point of the surface."""

DRAWN_A_VERTEX = 64
"""Points of the cloud that are enough, for each vertex of the base, to draw others from where they are."""

LEAST_CHANGE = 0.02
"""The noise is drawn again where it has to be smaller by more than this share."""


class WholeSurface:
    """Finds the nearest points of a surface from anywhere, through thin parts too.

    Parameters
    ----------
    representation, mesh
        The surface, and the base that carries it.
    apart
        How far the places may be apart that the search starts from, scene units.
    """

    def __init__(self, representation: Representation, mesh: TriangleMesh, apart: float) -> None:
        self.representation, self.mesh = representation, mesh
        edge = float(np.linalg.norm(np.diff(mesh.vertices[mesh.edges], axis=1), axis=2).mean())
        shares = INSIDE * triangle_grid(int(np.clip(np.ceil(edge / apart), 1, FINEST))) + (1.0 - INSIDE) * CENTROID
        self._starts = Footpoints(
            np.repeat(np.arange(len(mesh.triangles)), len(shares)), np.tile(shares, (len(mesh.triangles), 1))
        )
        self._tree = cKDTree(representation.evaluate(self._starts.triangle, self._starts.barycentric))

    def nearest(self, points: Array) -> tuple[Footpoints, Array]:
        """Where on the base the surface is nearest to points (P, 3), and how far that is, (P,)."""
        number = self._tree.query(points)[1]
        start = Footpoints(self._starts.triangle[number], self._starts.barycentric[number])
        return nearest_on_surface(self.representation, self.mesh, points, start, STEPS)

    def with_normals(self, feet: Footpoints) -> tuple[Array, Array]:
        """Points of the surface and its unit normals there, to the side that the base's winding says, (N, 3) each."""
        on_surface, tangents = self.representation.evaluate_with_tangents(feet.triangle, feet.barycentric)
        normals = np.cross(tangents[:, 0], tangents[:, 1])
        return on_surface, normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]

    def at(self, feet: Footpoints) -> Array:
        """Points of the surface, (N, 3)."""
        return self.representation.evaluate(feet.triangle, feet.barycentric)


def without_bias(
    cloud: ObservedCloud, points: Array, surface: WholeSurface, noise: float
) -> tuple[ObservedCloud, Array]:
    """Project points on a surface, and take from each what noise alone would have put it off there.

    Parameters
    ----------
    cloud
        What is observed: the points first, as they were moved before.
    points
        Where they really are, (P, 3).
    noise
        Their estimated noise.  Where the surface is nearer to them than to points drawn with that, less is drawn.

    Returns
    -------
    moved, distance
        What is observed now, and how far the points themselves are from the surface, (P,).
    """
    feet, distance = surface.nearest(points)
    moved = np.concatenate([points - bias(surface, feet, distance, noise), cloud.points[len(points) :]])
    return replace(cloud, points=moved).moved(feet, cloud.weights[: len(points)]), distance


def bias(surface: WholeSurface, feet: Footpoints, distance: Array, noise: float) -> Array:
    """How far noise puts points off the surface on average, at the places of points that are this far from it, (P, 3).

    Along the surface's normals: means of vectors would cancel where the surface bends.

    Parameters
    ----------
    feet, distance
        Places of the points on the base, and their distances from the surface, (P,).
    noise
        Most noise that is drawn.
    """
    most = DRAWN_A_VERTEX * len(surface.mesh.vertices)
    asked = np.unique(np.linspace(0, len(distance) - 1, min(len(distance), most)).astype(np.int64))
    places = surface.at(Footpoints(feet.triangle[asked], feet.barycentric[asked]))
    at_vertices, away = _drawn(surface, places, noise)
    less = float(np.median(distance)) / max(float(np.median(away)), 1e-300)
    if less < 1.0 - LEAST_CHANGE:
        at_vertices, _ = _drawn(surface, places, less * noise)
    outwards = interpolate(at_vertices[:, None], surface.mesh.triangles[feet.triangle], feet.barycentric)
    return outwards * surface.with_normals(feet)[1]


def _drawn(surface: WholeSurface, places: Array, noise: float) -> tuple[Array, Array]:
    """Draw points with noise from places (N, 3) of a surface: how far they are outside of it, around each vertex of the
    base, and their distances, (2 N,).

    What is drawn is drawn on the opposite side of its place, too: of it only what does not cancel is left.
    """
    noises = noise * np.random.default_rng(0).normal(size=places.shape)
    drawn = np.concatenate([places + noises, places - noises])
    feet, away = surface.nearest(drawn)
    on_surface, normals = surface.with_normals(feet)
    off = np.repeat(((drawn - on_surface) * normals).sum(axis=1), 3)
    count, shares = len(surface.mesh.vertices), feet.barycentric.ravel()
    half = np.repeat(np.tile(np.arange(len(places)) % 2, 2), 3)
    corners: Indices = surface.mesh.triangles[feet.triangle].ravel() + count * half
    weights, totals = (
        np.bincount(corners, own, 2 * count).astype(np.float64).reshape(2, count) for own in (shares, off * shares)
    )
    return significant(totals, weights), away


def significant(totals: Array, weights: Array) -> Array:
    """Means (V,) of both halves' sums (2, V) with weights (2, V), shrunk to what chance does not explain.

    By how much the halves differ tells the variance of a mean; its share of a squared mean is taken off (James, Stein).
    """
    weight = weights.sum(axis=0)
    mean = totals.sum(axis=0) / np.maximum(weight, 1.0)
    both = (weights > 1.0).all(axis=0)
    if not both.any():
        return np.zeros_like(mean)
    halves, sizes = totals[:, both] / weights[:, both], weights[:, both]
    variance = ((halves[0] - halves[1]) ** 2 / (1.0 / sizes).sum(axis=0)).mean()
    chance = variance / np.maximum(weight, 1.0)
    kept: Array = mean * np.maximum(1.0 - chance / np.maximum(mean**2, 1e-300), 0.0)
    return kept

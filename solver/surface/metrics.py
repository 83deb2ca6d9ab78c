"""Measures of an approximation, in scene units (surface error, inside triangles, is the one that counts)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Booleans, Indices, any_of, length_of, rows_at, runs_of_rows, slices_of, sum_of
from ..fitting.domain_energy import determinant
from ..mesh.edges import edge_keys, stable_order
from ..mesh.normals import angle_between, area_vectors, face_normals
from ..mesh.sampling import MEASURED_SAMPLES, points_inside
from ..processes.each import Each, all_done
from .representation import Representation

EDGE_SAMPLES = np.array([0.2, 0.5, 0.8])
"""Where the jump across a patch's rim is measured along an edge."""

POINTS_AT_ONCE, TRIANGLES_AT_ONCE = 150_000, 100_000
"""Measured together: more would only take memory."""


def statistics(error: Array) -> dict[str, float]:
    """Root mean square, mean, 95th percentile and maximum of distances; zeros where there are none."""
    if not len(error):
        return {"rms": 0.0, "mean": 0.0, "p95": 0.0, "max": 0.0}
    return {
        "rms": float(np.sqrt(np.mean(error**2))),
        "mean": float(error.mean()),
        "p95": float(np.percentile(error, 95)),
        "max": float(error.max()),
    }


def surface_error(
    representation: Representation,
    triangles: Indices | None = None,
    samples: Array = MEASURED_SAMPLES,
    vertices: Array | None = None,
    each: Each = map,
) -> Array:
    """|S(x) - x| at `samples` (q, 3) of every triangle, (T, q), or of the `triangles` named only.

    The points x lie on the triangles between `vertices`, (V, 3), which are the representation's own where None.
    """
    vertices = representation.vertices if vertices is None else vertices
    asked = np.arange(len(representation.triangles)) if triangles is None else triangles
    distance = np.empty((len(asked), len(samples)))

    def measure(block: slice) -> None:
        face = asked[block]
        flat = points_inside(vertices, rows_at(representation.triangles, face), samples)
        points = representation.evaluate(np.repeat(face, len(samples)), np.tile(samples, (len(face), 1)))
        distance[block] = length_of(points.reshape(flat.shape) - flat)

    representation.prepare(each)
    all_done(each, measure, _blocks(len(asked), len(samples)))
    return distance


def _blocks(count: int, points_each: int) -> Iterator[slice]:
    """Slices of `count` things with `points_each` points, so that memory stays bounded."""
    return slices_of(count, max(1, POINTS_AT_ONCE // points_each))


def seam(representation: Representation, each: Each = map) -> float:
    """Largest jump of the surface across patches' rims, the edges between triangles that different patches cover."""
    pairs = pairs_across_edges(representation)
    pairs = pairs.select(pairs.on_rim)

    def jump(block: slice) -> float:
        faces, corners = pairs.select(block).samples(EDGE_SAMPLES)
        points = representation.evaluate(faces.ravel(), corners.reshape(-1, 3)).reshape(*faces.shape, 3)
        return float(length_of(points[:, 0] - points[:, 1]).max())

    representation.prepare(each)
    return max(each(jump, _blocks(len(pairs), 2 * len(EDGE_SAMPLES))), default=0.0)


@dataclass(frozen=True)
class EdgePairs:
    """The E edges of a mesh between exactly two triangles.

    Attributes
    ----------
    triangles
        The two triangles, (2, E).
    corners
        The edge's ends as corners of each of them, the same end first, (2, E, 2).
    on_rim
        Where the two triangles are covered by different patches, so that the rim of a patch runs along the edge, (E,).
    """

    triangles: Indices
    corners: Indices
    on_rim: Booleans

    def __len__(self) -> int:
        return len(self.on_rim)

    def select(self, which: Booleans | slice) -> EdgePairs:
        """Return some of the edges."""
        return EdgePairs(self.triangles[:, which], self.corners[:, which], self.on_rim[which])

    def samples(self, along: Array) -> tuple[Indices, Array]:
        """Return points of each edge as points of both triangles: numbers (q, 2, E), coordinates (q, 2, E, 3).

        `along` says where between the edge's ends they are, (q,).
        """
        inside = np.zeros((len(along), *self.triangles.shape, 3))
        shares = np.stack([1.0 - along, along], axis=-1)[:, None, None]
        np.put_along_axis(inside, np.broadcast_to(self.corners, (len(along), *self.corners.shape)), shares, axis=-1)
        return np.broadcast_to(self.triangles, inside.shape[:-1]), inside


def pairs_across_edges(representation: Representation) -> EdgePairs:
    """Find the triangles that meet at edges of the input mesh, and the edges between them at which patches end."""
    triangles = representation.triangles
    starts, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    key = edge_keys(starts, ends, len(representation.vertices))
    order = stable_order(key)
    same = key[order][1:] == key[order][:-1]
    alone = np.ones(len(same), dtype=bool)
    # an edge of exactly two triangles: neither the pair before nor the one after shares it
    alone[1:] &= ~same[:-1]
    alone[:-1] &= ~same[1:]
    pair = np.flatnonzero(same & alone)
    both = np.stack([order[pair], order[pair + 1]])
    corners = np.stack([both % 3, (both + 1) % 3], axis=-1)
    one, other = both // 3
    swapped = triangles[one, corners[0, :, 0]] != triangles[other, corners[1, :, 0]]
    corners[1, swapped] = corners[1, swapped, ::-1]
    cover = _cover_fingerprint(representation)
    return EdgePairs(both // 3, corners, cover[one] != cover[other])


def _cover_fingerprint(representation: Representation) -> Indices:
    """A number for each triangle that is equal where the same patches cover it."""
    numbers = np.random.default_rng(0).integers(1, 2**62, size=representation.patches, dtype=np.int64)
    fingerprint = np.zeros(len(representation.triangles), dtype=np.int64)
    of_triangles = np.repeat(numbers, np.diff(representation.triangle_offsets))
    np.bitwise_xor.at(fingerprint, representation.mesh_triangles, of_triangles)
    return fingerprint


def normal_error(before: Array, after: Array, triangles: Indices) -> float:
    """Mean angle between the face normals of two meshes, degrees; triangles without area do not count."""
    one, other = face_normals(before, triangles), face_normals(after, triangles)
    usable = any_of(one != 0.0) & any_of(other != 0.0)
    if not usable.any():
        return 0.0
    return float(np.degrees(angle_between(one[usable], other[usable])).mean())


def faces_turned(before: Array, after: Array, offsets: Indices, corners: Indices) -> int:
    """Number of polygons whose normals in two meshes, (V, 3) each, are more than 90 degrees apart.

    Parameters
    ----------
    offsets, corners
        The polygons: where the corners of each begin, (F + 1,), and their vertices, (C,).
    """
    sizes = np.diff(offsets)
    if not len(sizes):
        return 0
    if (sizes == 3).all():
        one, other = (area_vectors(mesh, corners.reshape(-1, 3)) for mesh in (before, after))
        return int(np.count_nonzero(sum_of(one * other) < 0.0))
    following = np.arange(1, len(corners) + 1)
    following[offsets[1:] - 1] = offsets[:-1]
    normals = [
        # Newell's sum; about the first corner, so that it keeps its digits far from the origin
        np.add.reduceat(np.cross(own, own[following]), offsets[:-1])
        for own in (mesh[corners] - np.repeat(mesh[corners[offsets[:-1]]], sizes, axis=0) for mesh in (before, after))
    ]
    return int((sum_of(normals[0] * normals[1]) < 0.0).sum())


def domain_changes(representation: Representation, faces: int, each: Each = map) -> tuple[Array, int]:
    """What the domain transformations Phi_k do to the triangles.

    Parameters
    ----------
    faces
        Number of input faces, F.
    each
        Looks at some patches, perhaps several parts at once.

    Returns
    -------
    stretch
        Anisotropy on every input face, (F,): one where Phi_k is conformal, large along creases.  The ratio of the
        Jacobian's singular values, averaged over the patches with their blending weights, then over the face's
        triangles; one on faces that no patch covers.
    flipped
        Number of patch triangles whose orientation turned in some domain; those without area do not count.
    """
    table, offsets = representation.corners, representation.triangle_offsets

    def look(run: tuple[int, int]) -> tuple[Indices, Array, Array, int]:
        """Mesh triangles of some patches, (n,), their weights, these times the ratios, and how many are flipped."""
        rows = slice(*offsets[list(run)])
        corners = table[rows]
        ratio, flipped = np.zeros(len(corners)), 0
        for start, domain in zip(representation.initial_domains, representation.domains, strict=True):
            jacobian, known = _jacobians(start, domain, corners)
            ratio += _anisotropy(jacobian)
            flipped += int(((determinant(jacobian) < 0.0) & known).sum())
        weight = sum_of(rows_at(representation.weights, corners)) / 3.0
        return representation.mesh_triangles[rows], weight, weight * (ratio / len(representation.domains)), flipped

    count, flips = len(representation.triangles), 0
    total, summed = np.zeros(count), np.zeros(count)
    for triangle, weight, weighted, flipped in each(look, runs_of_rows(offsets, TRIANGLES_AT_ONCE)):
        np.add.at(total, triangle, weight)
        np.add.at(summed, triangle, weighted)
        flips += flipped
    by_triangle = np.divide(summed, total, out=np.ones(count), where=total > 0.0)
    triangles = np.maximum(np.bincount(representation.polygon, minlength=faces), 1)
    by_face = np.bincount(representation.polygon, weights=by_triangle, minlength=faces) / triangles
    return np.maximum(by_face, 1.0), flips


def _jacobians(start: Array, domain: Array, corners: NDArray[np.integer[Any]]) -> tuple[Array, Booleans]:
    """Jacobians of the maps that take triangles from one domain to another, (2, 2, S), and which had an area, (S,)."""
    (one, other), (moved, moved_other) = (_edges_from_first(own, corners) for own in (start, domain))
    doubled = one[0] * other[1] - one[1] * other[0]
    known = doubled != 0.0
    inverse = np.divide(1.0, doubled, out=np.zeros_like(doubled), where=known)
    along_u = (moved * other[1] - moved_other * one[1]) * inverse
    along_v = (moved_other * one[0] - moved * other[0]) * inverse
    return np.stack([along_u, along_v], axis=1), known


def _edges_from_first(domain: Array, corners: NDArray[np.integer[Any]]) -> tuple[Array, Array]:
    """Edges of triangles from their first corner to the two others, (2, S) each."""
    a, b, c = (np.ascontiguousarray(rows_at(domain, corner).T) for corner in corners.T)
    return b - a, c - a


def _anisotropy(jacobian: Array) -> Array:
    """Ratio of the singular values of matrices (2, 2, S); one where a matrix is zero."""
    turn = np.hypot(jacobian[0, 0] + jacobian[1, 1], jacobian[1, 0] - jacobian[0, 1])
    skew = np.hypot(jacobian[0, 0] - jacobian[1, 1], jacobian[1, 0] + jacobian[0, 1])
    smaller = np.maximum(np.abs(turn - skew), 1e-6 * (turn + skew))
    return np.divide(turn + skew, smaller, out=np.ones_like(turn), where=smaller > 0.0)


def strongest_patch(representation: Representation) -> NDArray[np.int32]:
    """Patch with the largest blending weight at every vertex, (V,), the first of equals; -1 where none has weight."""
    strongest = np.full(len(representation.vertices), -1, dtype=np.int32)
    patch = np.repeat(np.arange(representation.patches), np.diff(representation.vertex_offsets))
    order = np.lexsort((-patch, representation.weights))
    order = order[representation.weights[order] > 0.0]
    strongest[representation.patch_vertices[order]] = patch[order]
    return strongest

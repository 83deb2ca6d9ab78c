"""The base mesh under a point cloud: checked, wound consistently, drawn to the points and on to their creases.

The base only carries the parameters: where its vertices are does not matter for what the patches can represent.  But
points are projected on it and domains are unfolded from it, which works better the closer it lies.  And a domain
transformation bends along the base's edges, so these should lie along the creases.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from ..arrays import Array, Booleans, Indices
from ..errors import InputError
from ..mesh.closest_points import closest_points
from ..mesh.edges import edge_keys
from ..mesh.normals import face_normals
from ..mesh.projection import project
from ..mesh.triangle_mesh import TriangleMesh, build_mesh

STIFFNESS = 0.2
"""Weight of neighbours' equal displacement, as a share of the points that a vertex has on average."""

PROJECTIONS = 2
"""Rounds of projecting the points and moving the base."""

POINTS_A_VERTEX = 40
"""Points that are enough to move a vertex into place."""

POINTS_ASKED, FARTHEST_BASE = 2000, 0.25
"""A base is refused when half of these points lie farther from it than this share of the cloud's longest side."""

REACH, APART = 0.5, 0.45
"""A vertex moves to a crease within this many mean edges, unless a neighbour has moved this close to the place."""

BORDER_SPACINGS = 0.5
"""Vertices on the border of a base that is made lie within this many spacings of a point."""

OUTSIDE_SPACINGS, OUTSIDE_LEVELS = 0.7, 1.0
"""Points beyond its border are reached by it where they are farther than this many spacings and noise levels away."""

AROUND = 1.5
"""Points within this many lengths of a moved vertex's longest edge say whether the move was for the better."""

POINTS_OF_A_LINE, STRAIGHT = 6, 0.2
"""Points of a crease that show which way it runs on at a border, and how wide they may be for their length."""

LEAST_TURN = 0.3
"""Cosine of the largest angle by which such a move may turn a triangle."""


def checked_base(vertices: ArrayLike, faces: ArrayLike | Sequence[Sequence[int]]) -> TriangleMesh:
    """Build a base whose faces are wound consistently.

    Raises
    ------
    InputError
        When it is not a mesh, or not manifold.
    """
    mesh = build_mesh(vertices, faces)
    keys = edge_keys(mesh.triangles, np.roll(mesh.triangles, -1, axis=1), len(mesh.vertices))
    _, count = np.unique(keys, return_counts=True)
    if count.max() > 2:
        raise InputError(f"The base is not manifold: {int((count > 2).sum())} edges belong to more than two triangles.")
    if mesh.node_count > len(mesh.vertices):
        raise InputError("The base is not manifold: parts of it meet at single vertices.")
    turned = np.zeros(mesh.polygon_count, dtype=bool)
    turned[mesh.polygon[mesh.winding < 0]] = True
    if not turned.any():
        return mesh
    polygons = np.split(mesh.face_corners, mesh.face_offsets[1:-1])
    return build_mesh(
        mesh.vertices, [face[::-1] if turn else face for face, turn in zip(polygons, turned, strict=True)]
    )


def refuse_distant(points: Array, mesh: TriangleMesh) -> None:
    """Refuse a base that does not belong to the cloud.

    Raises
    ------
    InputError
        When it lies far from most points.
    """
    asked = _some(points, POINTS_ASKED)
    feet = closest_points(points[asked], mesh.vertices, mesh.triangles)
    away = float(np.median(np.linalg.norm(feet.on(mesh.vertices, mesh.triangles) - points[asked], axis=1)))
    size = float(np.ptp(points, axis=0).max())
    if away > FARTHEST_BASE * size:
        raise InputError(
            f"The base is far from the points: half of them are more than {away:.3g} away from it, "
            f"in a cloud {size:.3g} long."
        )


def drawn_to_points(mesh: TriangleMesh, points: Array, weights: Array) -> TriangleMesh:
    """Move the base's vertices so that its flat triangles come near the points: penalised least squares.

    Minimises sum w |p - x(p)|^2 with x(p) the point's place on the base, plus the squared differences of neighbours'
    displacements, and projects again; so vertices without points move with their neighbours (Hoppe et al. 1993).

    Parameters
    ----------
    points, weights
        (P, 3) and (P,).
    """
    start, end = mesh.edges.T
    count = len(mesh.vertices)
    asked = _some(points, POINTS_A_VERTEX * count)
    points, weights = points[asked], weights[asked]
    incidence = sp.csr_matrix(
        (
            np.repeat([1.0, -1.0], len(start)),
            (np.tile(np.arange(len(start)), 2), mesh.node_vertex[np.concatenate([start, end])]),
        ),
        shape=(len(start), count),
    )
    stiffness = STIFFNESS * weights.sum() / count * (incidence.T @ incidence)
    fitted = mesh
    for _ in range(PROJECTIONS):
        feet = project(points, fitted)
        row = np.repeat(np.arange(len(points)), 3)
        place = sp.csr_matrix(
            (feet.barycentric.ravel(), (row, mesh.triangles[feet.triangle].ravel())), shape=(len(points), count)
        )
        weighted = place.T @ sp.diags(weights)
        matrix = weighted @ place + stiffness
        matrix += sp.identity(count) * (1e-9 * matrix.diagonal().mean() + 1e-300)
        move = splu(matrix.tocsc()).solve(weighted @ (points - place @ mesh.vertices))
        fitted = without_folds(mesh, mesh.vertices + move)
    return fitted


def border_near_points(mesh: TriangleMesh, points: Array, reach: float) -> TriangleMesh:
    """Move vertices of the border that are farther than `reach` from the points (P, 3) there, unless triangles fold.

    No point holds them back from there, and patches have nothing to follow.
    """
    border = np.unique(mesh.node_vertex[mesh.border])
    distance, nearest = cKDTree(points).query(mesh.vertices[border])
    beyond = np.flatnonzero(distance > reach)
    vertices = mesh.vertices.copy()
    target = points[nearest[beyond]]
    share = (reach / distance[beyond])[:, None]
    vertices[border[beyond]] = target + share * (vertices[border[beyond]] - target)
    before = face_normals(mesh.vertices, mesh.triangles)
    while (turned := (before * face_normals(vertices, mesh.triangles)).sum(axis=1) < LEAST_TURN).any():
        folded = np.unique(mesh.triangles[turned])
        if np.array_equal(vertices[folded], mesh.vertices[folded]):
            break
        vertices[folded] = mesh.vertices[folded]
    return replace(mesh, vertices=vertices)


def border_out_to_points(mesh: TriangleMesh, points: Array, farthest: float) -> TriangleMesh:
    """Move vertices of the border onto points (P, 3) beyond it that are farther than this: corners that were cut off.

    The farthest point comes first and gets the nearest vertex of the border, unless triangles fold or the points
    around are farther from the base afterwards, by the sum of their squared distances.  No vertex moves twice.
    """
    left, beyond = _beyond_border(mesh, points)
    border, vertices = np.unique(mesh.node_vertex[mesh.border]), mesh.vertices.copy()
    wanted = beyond & (left > farthest)
    while wanted.any() and len(border):
        number = int(np.where(wanted, left, 0.0).argmax())
        wanted[number] = False
        vertex = border[np.linalg.norm(vertices[border] - points[number], axis=1).argmin()]
        moved, fan = vertices.copy(), mesh.triangles[(mesh.triangles == vertex).any(axis=1)]
        moved[vertex] = points[number]
        if ((face_normals(vertices, fan) * face_normals(moved, fan)).sum(axis=1) < LEAST_TURN).any():
            continue
        reach = AROUND * float(np.linalg.norm(moved[fan] - points[number], axis=2).max())
        near = np.flatnonzero(np.linalg.norm(points - points[number], axis=1) < reach)
        close = np.linalg.norm(moved[mesh.triangles] - points[number], axis=2).min(axis=1) < 2.0 * reach
        feet = closest_points(points[near], moved, mesh.triangles[close])
        now = np.linalg.norm(feet.on(moved, mesh.triangles[close]) - points[near], axis=1)
        if (now**2).sum() < (left[near] ** 2).sum():
            vertices, border = moved, border[border != vertex]
            left[near] = now
            wanted[near] &= now > farthest
    return replace(mesh, vertices=vertices)


def _beyond_border(mesh: TriangleMesh, points: Array) -> tuple[Array, Booleans]:
    """Distances of points (P, 3) from a mesh, and whether the nearest place of it is on its border, (P,) each."""
    feet = closest_points(points, mesh.vertices, mesh.triangles)
    at_border = np.zeros(len(mesh.vertices), dtype=bool)
    at_border[mesh.node_vertex[mesh.border]] = True
    counts = feet.barycentric > 1e-9
    along = ~counts.all(axis=1) & (at_border[mesh.triangles[feet.triangle]] | ~counts).all(axis=1)
    away = np.linalg.norm(feet.on(mesh.vertices, mesh.triangles) - points, axis=1)
    return away, np.asarray(along, dtype=np.bool_)


def snapped_to_creases(mesh: TriangleMesh, creases: Array) -> TriangleMesh:
    """Move vertices to the nearest crease where one passes near, so that edges lie along it.

    The nearest vertices move first.  A vertex stays where a neighbour has taken the place, or the move would fold the
    base.

    Parameters
    ----------
    creases
        Points on the creases, (C, 3).
    """
    if not len(creases):
        return mesh
    start, end = mesh.node_vertex[mesh.edges].T
    length = np.linalg.norm(mesh.vertices[start] - mesh.vertices[end], axis=1)
    count = np.bincount(start, minlength=len(mesh.vertices)) + np.bincount(end, minlength=len(mesh.vertices))
    total = np.bincount(start, length, len(mesh.vertices)) + np.bincount(end, length, len(mesh.vertices))
    edge = total / np.maximum(count, 1)
    distance, targets = _places_on_creases(mesh, creases)
    wanted = np.flatnonzero(distance < REACH * edge)
    vertices, moved = mesh.vertices.copy(), np.zeros(len(mesh.vertices), dtype=bool)
    for vertex in wanted[np.argsort(distance[wanted] / edge[wanted], kind="stable")]:
        target = targets[vertex]
        around = mesh.adjacency.indices[mesh.adjacency.indptr[vertex] : mesh.adjacency.indptr[vertex + 1]]
        rivals = around[moved[around]]
        if (np.linalg.norm(vertices[rivals] - target, axis=1) < APART * edge[vertex]).any():
            continue
        triangles = mesh.triangles[mesh.fan_triangles[mesh.fan_offsets[vertex] : mesh.fan_offsets[vertex + 1]]]
        before = face_normals(vertices, triangles)
        old, vertices[vertex] = vertices[vertex].copy(), target
        if ((before * face_normals(vertices, triangles)).sum(axis=1) < LEAST_TURN).any():
            vertices[vertex] = old
        else:
            moved[vertex] = True
    return replace(mesh, vertices=vertices)


def _places_on_creases(mesh: TriangleMesh, creases: Array) -> tuple[Array, Array]:
    """Distance of each vertex from the creases, (V,), and the place there that is nearest, (V, 3).

    At the border a crease runs on beyond its last point: a vertex there goes to its line, not back into the cloud.
    """
    tree, count = cKDTree(creases), min(POINTS_OF_A_LINE, len(creases))
    distance, nearest = tree.query(mesh.vertices)
    targets = creases[nearest]
    border = np.unique(mesh.node_vertex[mesh.border])
    around = creases[tree.query(targets[border], k=count)[1].reshape(len(border), count)]
    _, sizes, axes = np.linalg.svd(around - around.mean(axis=1, keepdims=True), full_matrices=False)
    along = ((mesh.vertices[border] - targets[border]) * axes[:, 0]).sum(axis=1)
    straight = sizes[:, 1:].max(axis=1, initial=0.0) < STRAIGHT * sizes[:, 0]
    targets[border] += np.where(straight, along, 0.0)[:, None] * axes[:, 0]
    distance[border] = np.linalg.norm(mesh.vertices[border] - targets[border], axis=1)
    return distance, targets


def _some(points: Array, count: int) -> Indices:
    """Numbers of at most `count` of the points, spread evenly over all of them."""
    return np.unique(np.linspace(0, len(points) - 1, min(count, len(points))).astype(np.int64))


def without_folds(mesh: TriangleMesh, vertices: Array) -> TriangleMesh:
    """Move the vertices towards new places, as far as no triangle turns over."""
    before = face_normals(mesh.vertices, mesh.triangles)
    for share in (1.0, 0.5, 0.25, 0.125):
        moved = mesh.vertices + share * (vertices - mesh.vertices)
        if ((before * face_normals(moved, mesh.triangles)).sum(axis=1) > 0.0).all():
            return replace(mesh, vertices=moved)
    return mesh

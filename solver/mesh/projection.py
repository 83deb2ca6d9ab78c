"""Projection of points on a triangle mesh: the closest point, then along smoothed normals.

The closest point alone is not enough to parameterise a cloud: above a convex edge of a coarse base whole wedges of
points fall on the edge itself, below a concave one none does.  Along normals that change linearly over each triangle
(Kobbelt et al. 1999's "Phong" projection) every part of the base gets its share, and neighbouring points stay
neighbours.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array, Booleans, Indices
from .triangle_mesh import TriangleMesh

FIRST_CANDIDATES = 8
PAIRS_AT_ONCE = 1_000_000
WALK_STEPS = 24
LONGEST_DETOUR = 3.0
"""A projection along normals may be so many times longer than the way to the closest point, plus a mean edge."""


@dataclass(frozen=True)
class Footpoints:
    """Where N points lie on a mesh.

    Attributes
    ----------
    triangle
        (N,).
    barycentric
        (N, 3), in [0, 1], one in sum.
    """

    triangle: Indices
    barycentric: Array

    def on(self, vertices: Array, triangles: Indices) -> Array:
        """Positions on a mesh of these triangles, (N, 3)."""
        return interpolate(vertices, triangles[self.triangle], self.barycentric)


def interpolate(values: Array, corners: Indices, barycentric: Array) -> Array:
    """Values (V, D) between the corners (N, 3) of triangles, (N, D)."""
    result: Array = (values[corners] * barycentric[:, :, None]).sum(axis=1)
    return result


def closest_points(points: Array, vertices: Array, triangles: Indices) -> Footpoints:
    """Closest point of a triangle mesh for each of the points (N, 3); exact.

    Triangles are tried in the order of their centroids' distances; as no point of a triangle is farther from its
    centroid than the largest circumscribed radius, the search knows when no other triangle can be closer.
    """
    ends = vertices[triangles]
    centroids = ends.mean(axis=1)
    largest = float(np.linalg.norm(ends - centroids[:, None], axis=2).max())
    tree = cKDTree(centroids)
    best = np.full(len(points), np.inf)
    triangle = np.zeros(len(points), dtype=np.int64)
    barycentric = np.zeros((len(points), 3))
    pending, tried, wanted = np.arange(len(points)), 0, min(FIRST_CANDIDATES, len(triangles))
    while len(pending):
        still = []
        for part in np.array_split(pending, max(1, -(-len(pending) * wanted // PAIRS_AT_ONCE))):
            distance, candidates = tree.query(points[part], k=list(range(tried + 1, wanted + 1)))
            for column in candidates.T:
                shares = closest_on_triangle(points[part], ends[column])
                apart = np.linalg.norm((ends[column] * shares[:, :, None]).sum(axis=1) - points[part], axis=1)
                closer = apart < best[part]
                where = part[closer]
                best[where], triangle[where], barycentric[where] = apart[closer], column[closer], shares[closer]
            still.append(part[distance[:, -1] - largest < best[part]])
        pending = np.concatenate(still) if wanted < len(triangles) else pending[:0]
        tried, wanted = wanted, min(2 * wanted, len(triangles))
    return Footpoints(triangle, barycentric)


def closest_on_triangle(points: Array, ends: Array) -> Array:
    """Barycentric coordinates (N, 3) of the closest point of one triangle (N, 3, 3) for each point (N, 3).

    The closest point lies inside, or on the closest of the three sides.
    """
    sides = np.roll(ends, -1, axis=1) - ends
    squared = (sides**2).sum(axis=2)
    along = ((points[:, None] - ends) * sides).sum(axis=2)
    share = np.clip(np.divide(along, squared, out=np.zeros_like(along), where=squared > 0.0), 0.0, 1.0)
    on_side = ends + share[:, :, None] * sides
    nearest = ((on_side - points[:, None]) ** 2).sum(axis=2).argmin(axis=1)
    row = np.arange(len(points))
    result = np.zeros((len(points), 3))
    result[row, nearest] = 1.0 - share[row, nearest]
    result[row, (nearest + 1) % 3] = share[row, nearest]
    normal = np.cross(sides[:, 0], sides[:, 1])
    area = (normal**2).sum(axis=1)
    inside = np.stack(
        [(np.cross(sides[:, (k + 1) % 3], points - ends[:, (k + 1) % 3]) * normal).sum(axis=1) for k in range(3)],
        axis=1,
    )
    within = (inside >= 0.0).all(axis=1) & (area > 0.0)
    result[within] = inside[within] / inside[within].sum(axis=1, keepdims=True)
    return result


def vertex_normals(mesh: TriangleMesh, smoothing: int = 1) -> Array:
    """Unit normals of the vertices, (V, 3): of the adjacent triangles weighted with their angles, then averaged with
    neighbours.

    Where the mesh has no orientation a triangle's normal counts as it is.
    """
    ends = mesh.vertices[mesh.triangles]
    turn = np.where(mesh.winding < 0, -1.0, 1.0)[:, None]
    crossed = np.asarray(np.cross(ends[:, 1] - ends[:, 0], ends[:, 2] - ends[:, 0]), dtype=np.float64)
    normals = turn * _unit(crossed)
    total = np.zeros_like(mesh.vertices)
    for corner in range(3):
        one = _unit(ends[:, (corner + 1) % 3] - ends[:, corner])
        two = _unit(ends[:, (corner + 2) % 3] - ends[:, corner])
        angle = np.arccos(np.clip((one * two).sum(axis=1), -1.0, 1.0))
        np.add.at(total, mesh.triangles[:, corner], angle[:, None] * normals)
    total = _unit(total)
    start, end = np.concatenate([mesh.node_vertex[mesh.edges], mesh.node_vertex[mesh.edges[:, ::-1]]]).T
    for _ in range(smoothing):
        around = total.copy()
        np.add.at(around, start, total[end] / 3.0)
        total = _unit(around)
    return total


def project(points: Array, mesh: TriangleMesh) -> Footpoints:
    """Project points (N, 3) on a mesh along its smoothed vertex normals; by closest point where that leads nowhere
    near.
    """
    start = closest_points(points, mesh.vertices, mesh.triangles)
    nearest = np.linalg.norm(start.on(mesh.vertices, mesh.triangles) - points, axis=1)
    normals = vertex_normals(mesh)

    def misses(which: Indices, feet: Footpoints) -> tuple[Array, Array]:
        corners = mesh.triangles[feet.triangle]
        normal = interpolate(normals, corners, feet.barycentric)
        offset = points[which] - interpolate(mesh.vertices, corners, feet.barycentric)
        height = (offset * normal).sum(axis=1) / np.maximum((normal**2).sum(axis=1), 1e-300)
        # derivative of x + height n along the triangle's sides: what is left is made orthogonal to the normal
        columns = [
            (mesh.vertices[corners[:, k]] - mesh.vertices[corners[:, 0]])
            + height[:, None] * (normals[corners[:, k]] - normals[corners[:, 0]])
            for k in (1, 2)
        ]
        return offset - height[:, None] * normal, np.stack([*columns, normal], axis=2)

    found, arrived = walk(mesh, start, misses)
    corners = mesh.triangles[found.triangle]
    way = np.linalg.norm(found.on(mesh.vertices, mesh.triangles) - points, axis=1)
    edge = np.linalg.norm(mesh.vertices[corners[:, 1]] - mesh.vertices[corners[:, 0]], axis=1)
    good = arrived & (way <= LONGEST_DETOUR * nearest + 0.5 * edge)
    return Footpoints(
        np.where(good, found.triangle, start.triangle), np.where(good[:, None], found.barycentric, start.barycentric)
    )


def walk(
    mesh: TriangleMesh,
    start: Footpoints,
    misses: Callable[[Indices, Footpoints], tuple[Array, Array]],
    steps: int = WALK_STEPS,
    tolerance: float = 1e-6,
) -> tuple[Footpoints, Booleans]:
    """Solve an equation for points on a mesh by Newton's method, from triangle to triangle.

    A step that leaves its triangle stops at the side and goes on in the triangle beyond; at an open border it slides.

    Parameters
    ----------
    misses
        For some of the points (their numbers, where they stand): what is missing, (n, r), and a matrix (n, r, 2 or
        more) whose first two columns are its derivatives along the triangle's sides 0 -> 1 and 0 -> 2, whose others may
        be anything that is solved for along the way.  Least squares where r exceeds the columns.
    steps
        Most Newton steps.
    tolerance
        A point has arrived when a step changes its barycentric coordinates by less.

    Returns
    -------
    footpoints, arrived
        Where the points are, and whether they arrived (N,).
    """
    triangle, barycentric = start.triangle.copy(), start.barycentric.copy()
    arrived = np.zeros(len(triangle), dtype=bool)
    moving = np.arange(len(triangle))
    for _ in range(steps):
        missing, slopes = misses(moving, Footpoints(triangle[moving], barycentric[moving]))
        change = _least_squares(slopes, missing)[:, :2]
        change = np.column_stack([-change.sum(axis=1), change])
        slid = _move(mesh, triangle, barycentric, moving, change)
        done = np.abs(slid).max(axis=1) < tolerance
        arrived[moving[done]] = True
        moving = moving[~done]
        if not len(moving):
            break
    return Footpoints(triangle, barycentric), arrived


def _move(mesh: TriangleMesh, triangle: Indices, barycentric: Array, moving: Indices, change: Array) -> Array:
    """Move points by changes of their barycentric coordinates, into the next triangle at most; returns what was
    moved.
    """
    before = barycentric[moving]
    after = before + change
    leaves = after < 0.0
    length = np.divide(before, before - after, out=np.full_like(before, np.inf), where=leaves)
    side = length.argmin(axis=1)
    row = np.arange(len(moving))
    limit = np.minimum(length[row, side], 1.0)
    stopped = before + limit[:, None] * change
    crossing = leaves.any(axis=1)
    stopped[row[crossing], side[crossing]] = 0.0
    at = moving[crossing]
    # the side opposite to corner k runs from corner k + 1 to k + 2 and has the number k + 1
    edge = mesh.triangle_edges[triangle[at], (side[crossing] + 1) % 3]
    pair = mesh.edge_triangles[edge]
    beyond = np.where(pair[:, 0] == triangle[at], pair[:, 1], pair[:, 0])
    beyond[edge < 0] = -1
    over = beyond >= 0
    slid = stopped - before
    border = np.flatnonzero(crossing)[~over]
    # at an open border: go on along it
    full = np.clip(after[border], 0.0, None)
    full /= full.sum(axis=1, keepdims=True)
    stopped[border] = full
    slid[border] = full - before[border]
    barycentric[moving] = stopped
    if over.any():
        who = at[over]
        old, new = triangle[who], beyond[over]
        same = mesh.nodes[new][:, :, None] == mesh.nodes[old][:, None, :]
        shares = (same * barycentric[who][:, None, :]).sum(axis=2)
        barycentric[who] = shares / shares.sum(axis=1, keepdims=True)
        triangle[who] = new
        # not there yet, however short the way to the side was
        slid[np.flatnonzero(crossing)[over]] = 1.0
    return slid


def _least_squares(matrices: Array, right: Array) -> Array:
    """Least squares of small systems (n, r, c), (n, r) by their normal equations, a little damped."""
    normal = np.matmul(matrices.swapaxes(1, 2), matrices)
    size = np.trace(normal, axis1=1, axis2=2)
    normal += (1e-12 * size + 1e-300)[:, None, None] * np.eye(normal.shape[1])
    target = np.matmul(matrices.swapaxes(1, 2), right[:, :, None])
    solution: Array = np.linalg.solve(normal, target)[:, :, 0]
    return solution


def _unit(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0)

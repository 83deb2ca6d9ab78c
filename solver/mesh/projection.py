"""Projection of points on a triangle mesh: to the closest point, then along smoothed normals.

The closest point alone cannot parameterise a cloud: above a convex edge of a coarse base, whole wedges of points fall
on the edge itself; below a concave edge, none does.  Along normals that change linearly over each triangle ("Phong"
projection, Kobbelt et al. 1999) the points spread over the whole base, and neighbours stay neighbours.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import Array, Booleans, Indices
from .closest_points import Footpoints, closest_points, interpolate
from .normals import face_normals, unit
from .triangle_mesh import TriangleMesh

WALK_STEPS = 24
LONGEST_DETOUR = 3.0
"""Most that a projection along normals may be longer than the way to the closest point, besides half an edge."""


def smoothed_normals(mesh: TriangleMesh, smoothing: int = 1) -> Array:
    """Unit normals of the vertices, (V, 3): of the adjacent triangles weighted with their angles, then averaged with
    neighbours.

    Where the mesh has no orientation, triangles keep their own winding.
    """
    ends = mesh.vertices[mesh.triangles]
    turn = np.where(mesh.winding < 0, -1.0, 1.0)[:, None]
    normals = turn * face_normals(mesh.vertices, mesh.triangles)
    total = np.zeros_like(mesh.vertices)
    for corner in range(3):
        one = unit(ends[:, (corner + 1) % 3] - ends[:, corner])
        two = unit(ends[:, (corner + 2) % 3] - ends[:, corner])
        angle = np.arccos(np.clip((one * two).sum(axis=1), -1.0, 1.0))
        np.add.at(total, mesh.triangles[:, corner], angle[:, None] * normals)
    total = unit(total)
    start, end = np.concatenate([mesh.node_vertex[mesh.edges], mesh.node_vertex[mesh.edges[:, ::-1]]]).T
    for _ in range(smoothing):
        around = total.copy()
        np.add.at(around, start, total[end] / 3.0)
        total = unit(around)
    return total


def project(points: Array, mesh: TriangleMesh) -> Footpoints:
    """Project points (N, 3) on a mesh along smoothed vertex normals, or to the closest point where that is too far."""
    start = closest_points(points, mesh.vertices, mesh.triangles)
    nearest = np.linalg.norm(start.on(mesh.vertices, mesh.triangles) - points, axis=1)
    normals = smoothed_normals(mesh)

    def misses(which: Indices, feet: Footpoints) -> tuple[Array, Array]:
        corners = mesh.triangles[feet.triangle]
        normal = interpolate(normals, corners, feet.barycentric)
        offset = points[which] - interpolate(mesh.vertices, corners, feet.barycentric)
        height = (offset * normal).sum(axis=1) / np.maximum((normal**2).sum(axis=1), 1e-300)
        # derivative of x + height n along the triangle's sides; the miss has no part along the normal
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

    A step that leaves its triangle stops at the side and continues in the triangle beyond; at an open border it slides.

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
    """Move points by changes of their barycentric coordinates, to the next triangle at most; return what they moved."""
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

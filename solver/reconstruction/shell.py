"""Coarse meshes around a point cloud: which side of a thick shell is the surface, and whether the cloud is open.

A mesh around balls at the points, each a few spacings wide, has one surface outside of a closed cloud and another one
inside of it; around an open cloud it has a single one, which runs along both sides of the sheet.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree

from ..arrays import Array, Booleans, Indices
from ..mesh.decimation import triangle_shapes
from ..mesh.edges import connected_parts, edge_keys
from ..mesh.triangle_mesh import build_mesh
from .holes import without_small_holes
from .level_set import Grid, level_set

NEIGHBOURS, MOST_NEIGHBOURS, TREE_NEIGHBOURS = 24, 256, 12
WIDEST_GAP = np.radians(150.0)
"""A point whose neighbours leave a wider angle free in its tangent plane lies on a border."""

NOISE_RADII = 4.0
"""The neighbours reach at least this many noise levels: those of fewer lie all around, whatever the surface."""

BORDER_POINTS = 0.6
"""A cloud of P points is open when more than this multiple of the root of P lie on a border.  On a square of evenly
spread points it is 4; of evenly random ones a bin without a lid has 0.75 and more, a closed box 0.06 at most."""

SMALLEST_SHARE = 0.01
"""Parts of a shell with a smaller share of the largest part's volume, or triangles, are left out."""

OFF_CENTRE = 0.45
"""The surface ends where the mean of the nearest points is off by more than this share of the farthest one's distance;
on a straight border it is the centroid of a half disk, off by 4 / (3 pi) = 0.42."""

SMALLEST_CAVITY = 1.5
"""A cavity smaller than a cube of this many ball radii does not show that the shell is closed."""

SHEET_NEIGHBOURS, SHEET_REACH, NOISE_STEPS = 12, 3.5, 2.0
"""Points whose planes decide the signed distance, steps of the grid within which it counts, and how much longer these
are in noise, in standard deviations."""

SMALL_HOLE = 3.0
"""A hole this many steps wide, where points beside a fold happen to be sparse, is closed: nothing is cut off there."""

SMOOTHING_ROUNDS = 40

WORST_SHAPE, SLIVER_ROUNDS = 0.2, 8
"""A triangle at the border is left out below this shape, of 1 for an equilateral one; rounds of looking for them."""


def parts(triangles: Indices, count: int) -> Indices:
    """Number of the connected part that each of `count` vertices belongs to, (V,)."""
    return connected_parts(triangles[:, :2].ravel(), triangles[:, 1:].ravel(), count)[1]


def signed_volumes(vertices: Array, triangles: Indices, part: Indices) -> Array:
    """Volume that each part of a closed mesh encloses, negative where it is wound inwards, (parts,)."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    pieces = (a * np.cross(b, c)).sum(axis=1) / 6.0
    count = int(part.max(initial=-1)) + 1
    return np.bincount(part[triangles[:, 0]], weights=pieces, minlength=count).astype(np.float64)


def has_cavity(vertices: Array, triangles: Indices, radius: float) -> bool:
    """Whether a shell of balls of this radius, wound outwards, encloses a cavity larger than (1.5 radius)^3."""
    volumes = signed_volumes(vertices - vertices.mean(axis=0), triangles, parts(triangles, len(vertices)))
    return bool(volumes.min(initial=0.0) < -((SMALLEST_CAVITY * radius) ** 3))


def outer_parts(vertices: Array, triangles: Indices) -> tuple[Array, Indices]:
    """The parts of a shell that enclose the others, without tiny ones."""
    part = parts(triangles, len(vertices))
    volumes = signed_volumes(vertices - vertices.mean(axis=0), triangles, part)
    kept = volumes > SMALLEST_SHARE * volumes.max(initial=0.0)
    return without_loose(vertices, triangles[kept[part[triangles[:, 0]]]])


def without_loose(vertices: Array, triangles: Indices) -> tuple[Array, Indices]:
    """Leave out the vertices that no triangle uses."""
    used, numbered = np.unique(triangles, return_inverse=True)
    return vertices[used], numbered.reshape(-1, 3).astype(np.int64)


def border_edges(triangles: Indices, count: int) -> Indices:
    """Edges of one triangle only, (B, 2), of a mesh with `count` vertices."""
    keys, uses = np.unique(edge_keys(triangles, np.roll(triangles, -1, axis=1), count), return_counts=True)
    return np.stack(np.divmod(keys[uses == 1], count), axis=1)


def without_slivers(vertices: Array, triangles: Indices) -> tuple[Array, Indices]:
    """Leave out slivers at the border of a manifold, as long as no part falls off."""
    for _ in range(SLIVER_ROUNDS):
        count = len(vertices)
        border = border_edges(triangles, count)
        at_border = np.zeros(count, dtype=bool)
        at_border[border] = True
        sides = edge_keys(triangles, np.roll(triangles, -1, axis=1), count)
        outer = np.isin(sides, edge_keys(border[:, 0], border[:, 1], count))
        tip = np.roll(triangles, -2, axis=1)
        # one side on the border and the tip inside, or the two sides of an ear
        free = (outer & ~at_border[tip]).any(axis=1) | (outer.sum(axis=1) == 2)
        sliver = free & (triangle_shapes(vertices, triangles) < WORST_SHAPE)
        if not sliver.any():
            break
        vertices, triangles = without_loose(vertices, triangles[~_first_at_each_vertex(triangles, sliver)])
    return vertices, triangles


def _first_at_each_vertex(triangles: Indices, chosen: Booleans) -> Booleans:
    """Which of the chosen triangles meet no earlier chosen one."""
    numbers = np.flatnonzero(chosen)
    first = np.full(triangles.max(initial=0) + 1, len(triangles))
    np.minimum.at(first, triangles[numbers], numbers[:, None])
    alone = np.zeros(len(triangles), dtype=bool)
    alone[numbers] = (first[triangles[numbers]] == numbers[:, None]).all(axis=1)
    return alone


def unpinched(vertices: Array, triangles: Indices) -> tuple[Array, Indices]:
    """Give parts that meet at a single vertex one each, without the tiny parts."""
    mesh = build_mesh(vertices, triangles)
    return _large_parts(mesh.vertices[mesh.node_vertex], mesh.nodes)


def neighbours_in_noise(spacing: float, noise: float) -> int:
    """Number of neighbours, a point itself included, that reach far enough beyond the noise to show a surface.

    A disk of radius r holds pi (r / spacing)^2 points of a surface.

    Examples
    --------
    >>> from sparse_surface.solver.reconstruction.shell import neighbours_in_noise
    >>> neighbours_in_noise(1.0, 0.0), neighbours_in_noise(1.0, 2.0)
    (24, 201)
    """
    reach = NOISE_RADII * noise / max(spacing, 1e-300)
    return int(np.clip(np.pi * reach**2, NEIGHBOURS, MOST_NEIGHBOURS))


def is_open(points: Array, spacing: float, noise: float) -> bool:
    """Whether a cloud (P, 3) has a border: many of its points have neighbours on one side only."""
    count = min(neighbours_in_noise(spacing, noise), len(points))
    near = cKDTree(points).query(points, k=count)[1]
    around = points[near[:, 1:]] - points[:, None]
    centred = points[near] - points[near].mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.matmul(centred.swapaxes(1, 2), centred))
    u, v = np.ascontiguousarray(np.moveaxis(np.matmul(around, axes[:, :, 1:]), -1, 0))
    angle = np.sort(np.arctan2(v, u), axis=1)
    gaps = np.diff(angle, axis=1, append=angle[:, :1] + 2.0 * np.pi)
    return int((gaps.max(axis=1) > WIDEST_GAP).sum()) > BORDER_POINTS * np.sqrt(len(points))


def oriented_normals(points: Array, normals: Array) -> Array:
    """Turn normals (P, 3) so that neighbours agree, along a spanning tree of the most parallel ones (Hoppe 1992).

    Each connected part of the neighbourhood graph is oriented by itself.
    """
    count = len(points)
    near = cKDTree(points).query(points, k=min(TREE_NEIGHBOURS, count))[1]
    start, end = np.repeat(np.arange(count), near.shape[1] - 1), near[:, 1:].ravel()
    cost = 1.0 - np.abs((normals[start] * normals[end]).sum(axis=1)) + 1e-6
    tree = minimum_spanning_tree(sp.csr_matrix((cost, (start, end)), shape=(count, count)))
    _, part = connected_components(tree, directed=False)
    parent = np.arange(count)
    for root in np.unique(part, return_index=True)[1]:
        order, before = breadth_first_order(tree, root, directed=False)
        parent[order[1:]] = before[order[1:]]
    turn = np.where((normals * normals[parent]).sum(axis=1) < 0.0, -1.0, 1.0)
    # each round doubles the way to the root that a point's sign takes in
    while (parent != parent[parent]).any():
        turn, parent = turn * turn[parent], parent[parent]
    return normals * (turn * turn[parent])[:, None]


def sheet(points: Array, spacing: float, noise: float) -> tuple[Array, Indices]:
    """Lay a sheet through an open cloud: where the signed distance from its points' planes is zero (Hoppe et al. 1992).

    What extends beyond the border of the points is cut off.
    """
    tree = cKDTree(points)
    normals = oriented_normals(points, _smooth_normals(points, tree))
    step = spacing + NOISE_STEPS * noise
    grid = Grid.around(points, SHEET_REACH * step, step)
    places = grid.positions
    distance, near = tree.query(places, k=min(SHEET_NEIGHBOURS, len(points)))
    weight = np.exp(-((distance / step) ** 2) + (distance[:, :1] / step) ** 2)
    along = ((places[:, None] - points[near]) * normals[near]).sum(axis=2)
    signed = (weight * along).sum(axis=1) / weight.sum(axis=1)
    vertices, triangles = level_set(grid, np.where(distance[:, 0] < SHEET_REACH * step, signed, np.nan))
    vertices, triangles = without_small_holes(*_large_parts(vertices, triangles), SMALL_HOLE * step)
    vertices, triangles = _trimmed(vertices, triangles, points, tree)
    return smoothed(vertices, triangles), triangles


def _trimmed(vertices: Array, triangles: Indices, points: Array, tree: cKDTree) -> tuple[Array, Indices]:
    """Cut off what lies beyond the points, from the sheet's border inwards: a sparse place inside becomes no hole."""
    beyond = _beyond(vertices[triangles].mean(axis=1), points, tree)
    count = len(vertices)
    part = parts(triangles[beyond], count)
    reached = np.zeros(part.max(initial=0) + 1, dtype=bool)
    reached[part[np.unique(border_edges(triangles, count))]] = True
    return unpinched(*_large_parts(vertices, triangles[~(beyond & reached[part[triangles[:, 0]]])]))


def _smooth_normals(points: Array, tree: cKDTree) -> Array:
    """Normals of planes of least squares, (P, 3)."""
    around = points[tree.query(points, k=min(NEIGHBOURS, len(points)))[1]]
    around = around - around.mean(axis=1, keepdims=True)
    normals: Array = np.linalg.eigh(np.matmul(around.swapaxes(1, 2), around))[1][:, :, 0]
    return normals


def _beyond(positions: Array, points: Array, tree: cKDTree) -> Booleans:
    """Which positions (N, 3) on the surface have the cloud's points to one side only."""
    distance, near = tree.query(positions, k=min(NEIGHBOURS, len(points)))
    off = np.linalg.norm(points[near].mean(axis=1) - positions, axis=1)
    return np.asarray(off > OFF_CENTRE * distance[:, -1], dtype=np.bool_)


def _large_parts(vertices: Array, triangles: Indices) -> tuple[Array, Indices]:
    """Leave out the connected parts with few triangles."""
    part = parts(triangles, len(vertices))[triangles[:, 0]]
    size = np.bincount(part, minlength=1)
    return without_loose(vertices, triangles[size[part] > SMALLEST_SHARE * size.max()])


def smoothed(vertices: Array, triangles: Indices) -> Array:
    """Smooth a sheet whose noise and jagged border would slow decimation down, (V, 3).

    Vertices of the border are averaged with their neighbours along it, all others with all of theirs.
    """
    count = len(vertices)
    keys, uses = np.unique(edge_keys(triangles, np.roll(triangles, -1, axis=1), count), return_counts=True)
    edges = np.stack(np.divmod(keys, count), axis=1)
    along = edges[uses == 1]
    on_border = np.zeros(len(vertices), dtype=bool)
    on_border[along] = True
    rows = np.concatenate([along, along[:, ::-1], edges, edges[:, ::-1]])
    rows = rows[np.repeat([True, False], [2 * len(along), 2 * len(edges)]) | ~on_border[rows[:, 0]]]
    weights = 1.0 / np.bincount(rows[:, 0], minlength=len(vertices))[rows[:, 0]]
    average = sp.csr_matrix((weights, rows.T), shape=(len(vertices), len(vertices)))
    smooth = vertices
    for _ in range(SMOOTHING_ROUNDS):
        smooth = 0.5 * (smooth + average @ smooth)
    return smooth

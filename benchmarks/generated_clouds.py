"""Generated point clouds with their bases: the paper's three cases (Fig. 13), and clouds whose true surface is known.

The same arguments give the same cloud.  Lengths are such that the true surface's longest side is 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from ..solver.mesh.closest_points import closest_points, interpolate
from ..solver.mesh.triangulation import triangulate
from .model_pieces import box_surface, geodesic_sphere

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Cloud:
    """A point cloud over a base mesh.

    Attributes
    ----------
    points
        (P, 3).
    base_vertices, base_faces
        The base, wound outwards.
    distance
        Distances (N,) of points (N, 3) from the true surface.
    creases
        Points on the true surface's sharp edges, (C, 3); none where it is smooth.
    """

    points: Floats
    base_vertices: Floats
    base_faces: Integers
    distance: Callable[[Floats], Floats]
    creases: Floats


# ------------------------------------------------------------------------------------------------- the paper's cases


def ball(points: int = 1410, base: int = 24, noise: float = 0.0, seed: int = 0) -> Cloud:
    """Return a sphere of diameter 1 with radial noise of this standard deviation; the base's vertices are cloud
    points.
    """
    random = np.random.default_rng(seed)
    directions = random.normal(size=(points, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    cloud = directions * (0.5 + noise * random.normal(size=(points, 1)))
    chosen = cKDTree(directions).query(_even_directions(base))[1]
    vertices = cloud[chosen]

    def distance(where: Floats) -> Floats:
        return np.abs(np.linalg.norm(where, axis=1) - 0.5)

    return Cloud(cloud, vertices, _hull(directions[chosen]), distance, np.zeros((0, 3)))


def airplane(points: int = 9730, seed: int = 0) -> Cloud:
    """Return a solid with fuselage, swept wings and tail, curved faces and creases, over 154 vertices on its
    surface.
    """
    coarse = _airplane_cells()
    base, quads = box_surface(coarse, jitter=0.0)
    split = 6
    fine, fine_quads = box_surface(np.kron(coarse, np.ones((split,) * 3, dtype=bool)), jitter=0.0)
    triangles, _ = triangulate(fine, fine_quads.reshape(-1), 4 * np.arange(len(fine_quads) + 1))
    creases = _sharp_edges(fine, fine_quads)
    shape = np.array(coarse.shape)
    size = np.ptp(_airplane(fine / split, shape), axis=0).max()
    true = _airplane(fine / split, shape) / size
    vertices = _airplane(base, shape) / size
    cloud = sample_triangles(true, triangles, points, seed)
    return Cloud(cloud, vertices, quads, _distance_from(true, triangles), true[creases].mean(axis=1))


def head(points: int = 26909, base: int = 428, seed: int = 0) -> Cloud:
    """Return a smooth head with nose, brows, chin and ears over a base of `base` vertices."""
    directions, triangles = geodesic_sphere(80, jitter=0.0)
    true = directions * _head_radius(directions)[:, None]
    size = np.ptp(true, axis=0).max()
    random = np.random.default_rng(seed).normal(size=(points, 3))
    random /= np.linalg.norm(random, axis=1, keepdims=True)
    around = _even_directions(base)
    vertices = around * _head_radius(around)[:, None] / size
    cloud = random * _head_radius(random)[:, None] / size
    return Cloud(cloud, vertices, _hull(around), _distance_from(true / size, triangles), np.zeros((0, 3)))


# ---------------------------------------------------------------------------------------------------- known surfaces


def box(points: int = 9730, cells: int = 5, noise: float = 0.0, seed: int = 0) -> Cloud:
    """Return a box over a base that ignores its edges: a grid of 6 cells^2 + 2 vertices, turned, on the box's
    surface.
    """
    half = np.array([0.5, 0.4, 0.3])
    grid, quads = box_surface(np.ones((cells,) * 3, dtype=bool), jitter=0.0)
    directions = (grid / cells - 0.5) @ _rotation(np.array([1.0, 2.0, 3.0]), 0.6).T
    vertices = directions / (np.abs(directions) / half).max(axis=1, keepdims=True)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    triangles = _hull(corners)
    cloud = sample_triangles(corners, triangles, points, seed)
    cloud = cloud + noise * np.random.default_rng(seed + 1).normal(size=cloud.shape)
    creases = sample_segments(corners, _hull_edges(corners, triangles))
    return Cloud(cloud, vertices, quads, _distance_from(corners, triangles), creases)


def l_solid(points: int = 10000, noise: float = 0.0, seed: int = 0) -> Cloud:
    """Return an L-shaped solid, sampled evenly; its base is the solid itself in quads of 1/8."""
    solid = np.ones((2, 2, 1), dtype=bool)
    solid[1, 1] = False
    corners, quads = box_surface(solid, jitter=0.0)
    true = corners / 2 - [0.5, 0.5, 0.25]
    triangles, _ = triangulate(true, quads.reshape(-1), 4 * np.arange(len(quads) + 1))
    cloud = sample_triangles(true, triangles, points, seed)
    cloud = cloud + noise * np.random.default_rng(seed + 1).normal(size=cloud.shape)
    creases = sample_segments(true, _sharp_edges(true, quads))
    base, base_quads = box_surface(np.kron(solid, np.ones((4, 4, 4), dtype=bool)), jitter=0.0)
    return Cloud(cloud, base / 8 - [0.5, 0.5, 0.25], base_quads, _distance_from(true, triangles), creases)


def hill(points: int = 4000, base: int = 9, noise: float = 0.0, seed: int = 0) -> Cloud:
    """Return an open sheet: a hill over the unit square, its base a grid of `base` x `base` vertices on it."""
    random = np.random.default_rng(seed)
    plane = random.uniform(-0.5, 0.5, size=(points, 2))
    cloud = np.column_stack([plane, _hill_height(plane) + noise * random.normal(size=points)])
    fine_plane, fine_triangles = _square_grid(120)
    plane, faces = _square_grid(base - 1)
    vertices = np.column_stack([plane, _hill_height(plane)])
    true = np.column_stack([fine_plane, _hill_height(fine_plane)])
    return Cloud(cloud, vertices, faces, _distance_from(true, fine_triangles), np.zeros((0, 3)))


CLOUDS: dict[str, Callable[[], Cloud]] = {"ball": ball, "airplane": airplane, "head": head}
"""The generated clouds in the place of the paper's."""


# ---------------------------------------------------------------------------------------------------------- sampling


def sample_triangles(vertices: Floats, triangles: Integers, count: int, seed: int = 0) -> Floats:
    """Return random points on triangles, evenly by area, (count, 3)."""
    random = np.random.default_rng(seed)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = random.choice(len(triangles), size=count, p=area / area.sum())
    one, two = random.uniform(size=(2, count))
    beyond = one + two > 1.0
    one[beyond], two[beyond] = 1.0 - one[beyond], 1.0 - two[beyond]
    shares = np.column_stack([1.0 - one - two, one, two])
    return interpolate(vertices, triangles[chosen], shares)


def sample_segments(vertices: Floats, edges: Integers, spacing: float = 0.01) -> Floats:
    """Return points at even distances on segments between vertices."""
    pieces = []
    for start, end in vertices[edges]:
        count = max(int(np.ceil(np.linalg.norm(end - start) / spacing)), 1)
        share = (np.arange(count) + 0.5)[:, None] / count
        pieces.append((1 - share) * start + share * end)
    return np.concatenate(pieces)


def _distance_from(vertices: Floats, triangles: Integers) -> Callable[[Floats], Floats]:
    def distance(where: Floats) -> Floats:
        feet = closest_points(where, vertices, triangles)
        result: Floats = np.linalg.norm(feet.on(vertices, triangles) - where, axis=1)
        return result

    return distance


# ------------------------------------------------------------------------------------------------------------ pieces


def _even_directions(count: int) -> Floats:
    """Return unit vectors in a spiral of equal areas (Fibonacci lattice)."""
    number = np.arange(count) + 0.5
    height = 1.0 - 2.0 * number / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * number
    radius = np.sqrt(1.0 - height**2)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])


def _hull(points: Floats) -> Integers:
    """Return the triangles of the convex hull of points around the origin, wound outwards."""
    hull = ConvexHull(points)
    triangles = hull.simplices.astype(np.int64)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    inwards = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0.0
    triangles[inwards] = triangles[inwards][:, [0, 2, 1]]
    # The order that the library gives is not promised.
    first = triangles.argmin(axis=1)
    triangles = np.take_along_axis(triangles, (first[:, None] + np.arange(3)) % 3, axis=1)
    return triangles[np.lexsort(triangles.T[::-1])]


def _hull_edges(points: Floats, triangles: Integers) -> Integers:
    """Return the edges of a box's hull, without the diagonals of its faces."""
    edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    along_axis = (np.abs(points[edges[:, 0]] - points[edges[:, 1]]) > 1e-9).sum(axis=1) == 1
    return edges[along_axis]


def _sharp_edges(vertices: Floats, quads: Integers) -> Integers:
    """Return the edges of a grid's surface at which two sides of different direction meet."""
    normals = np.cross(vertices[quads[:, 1]] - vertices[quads[:, 0]], vertices[quads[:, 3]] - vertices[quads[:, 0]])
    edges = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    normal = np.repeat(np.round(normals / np.linalg.norm(normals, axis=1, keepdims=True)), 4, axis=0)[order]
    pairs = edges[order].reshape(-1, 2, 2)
    bent = (np.abs(normal.reshape(-1, 2, 3)[:, 0] - normal.reshape(-1, 2, 3)[:, 1]) > 0.5).any(axis=1)
    return pairs[bent, 0]


def _rotation(axis: Floats, angle: float) -> Floats:
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def _square_grid(cells: int) -> tuple[Floats, Integers]:
    row, column = np.divmod(np.arange((cells + 1) ** 2), cells + 1)
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    triangles = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    return np.column_stack([column, row]) / cells - 0.5, triangles


def _hill_height(plane: Floats) -> Floats:
    x, y = plane.T
    return 0.25 * np.exp(-6.0 * (x**2 + y**2)) + 0.04 * np.sin(5.0 * x + 2.0 * y)


def _airplane_cells() -> NDArray[np.bool_]:
    """Return the airplane as cells (along, across, up): fuselage, wings of 3 x 4, tail of 2 x 2, fin of 2."""
    cells = np.zeros((14, 9, 2), dtype=bool)
    cells[:, 4, 0] = True
    cells[5:8, :, 0] = True
    cells[11:13, 2:7, 0] = True
    cells[11:13, 4, 1] = True
    return cells


def _airplane(grid: Floats, shape: Integers) -> Floats:
    """Move grid points to where the airplane has them: smooth but for the roots of wings and fin, which are creases."""
    x, y, z = grid[:, 0], grid[:, 1] - shape[1] / 2, grid[:, 2]
    out, up = np.maximum(np.abs(y) - 0.5, 0.0), np.maximum(z - 1.0, 0.0)
    inside = np.sign(y) * np.minimum(np.abs(y), 0.5)
    nose = 0.4 + 0.6 * np.sin(0.5 * np.pi * np.clip(x / 5.0, 0.0, 1.0))
    tail = 1.0 - 0.5 * np.clip((x - 8.0) / 6.0, 0.0, 1.0) ** 2
    girth = 1.6 * nose * tail
    level = (np.minimum(z, 1.0) - 0.5) * girth / (1.0 + 0.9 * out)
    return np.column_stack(
        [
            x + 0.55 * out + 0.7 * up,
            (inside * girth + 1.2 * np.sign(y) * out) / (1.0 + 2.5 * up),
            level + 1.6 * up + 0.12 * out + 0.06 * (x - 7.0) ** 2 / 7.0,
        ]
    )


def _head_radius(directions: Floats) -> Floats:
    """Radius of the head in unit directions (N, 3): the face looks along +x, +z is up."""
    x, y, z = directions.T
    radius = 1.0 + 0.18 * z - 0.1 * x * z + 0.06 * x**2 - 0.12 * y**2
    bumps = [  # direction, width, height
        ((1.0, 0.0, -0.05), 0.20, 0.16),  # nose
        ((1.0, 0.38, 0.25), 0.22, -0.07),
        ((1.0, -0.38, 0.25), 0.22, -0.07),
        ((1.0, 0.3, 0.6), 0.3, 0.05),
        ((1.0, -0.3, 0.6), 0.3, 0.05),
        ((1.0, 0.0, -0.75), 0.28, 0.10),  # chin
        ((1.0, 0.0, -0.38), 0.18, -0.04),
        ((0.05, 1.0, 0.0), 0.22, 0.10),  # ears
        ((0.05, -1.0, 0.0), 0.22, 0.10),
        ((-0.2, 0.0, -1.0), 0.6, 0.25),  # neck
        ((-1.0, 0.0, 0.3), 0.7, 0.12),
    ]
    for direction, width, height in bumps:
        axis = np.array(direction) / np.linalg.norm(direction)
        radius = radius + height * np.exp(-0.5 * ((1.0 - directions @ axis) * 2.0) / width**2)
    return radius

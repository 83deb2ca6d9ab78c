"""What generated models are made of: surfaces of solids, prisms, spheres, grids, and numbers that look random."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from ..solver.mesh.triangulation import triangulate

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Model = tuple[Floats, Integers]

JITTER = 0.18  # of a cell, to either side


def box_surface(solid: NDArray[np.bool_], jitter: float) -> Model:
    """Return the surface of a solid of unit cells as quads, vertices at whole numbers plus jitter."""
    padded = np.pad(solid, 1)
    shape = np.array(padded.shape)
    quads, axes = [], []
    for axis in range(3):
        across, up = (axis + 1) % 3, (axis + 2) % 3
        step = np.diff(padded.astype(np.int8), axis=axis)
        for sign in (1, -1):
            low = np.argwhere(step == sign)
            low[:, axis] += 1
            corners = np.repeat(low[:, None, :], 4, axis=1)
            corners[:, [1, 2], across] += 1
            corners[:, [2, 3], up] += 1
            quads.append(corners[:, ::-1] if sign == 1 else corners)
            axes.append(np.full(len(low), axis))
    corners = np.concatenate(quads)
    key = (corners * np.array([shape[1] * shape[2], shape[2], 1])).sum(axis=2)
    _, first, faces = np.unique(key.reshape(-1), return_index=True, return_inverse=True)
    faces = faces.reshape(-1, 4)
    vertices = corners.reshape(-1, 3)[first] - 1.0
    # A vertex may move along an axis when none of its faces stands across that axis.
    free = np.ones((len(vertices), 3), dtype=bool)
    free[faces.reshape(-1), np.repeat(np.concatenate(axes), 4)] = False
    return vertices + jitter / JITTER * steady_random(vertices.shape, seed=1) * free, faces


def prism(cells: int, layers: int, outline: Callable[[Floats], Floats], height: float, half_size: float) -> Model:
    """Return a closed prism over the outline radius(angle): quads, `cells` across an end, `layers` in the wall."""
    disk, quads, border = disk_grid(cells, jitter=JITTER)
    count, around = len(disk), len(border)
    x, y = np.ascontiguousarray(disk.T)
    angle = np.arctan2(y, x)
    end = disk * outline(angle)[:, None]
    turn, step = np.divmod(np.arange(around * (layers - 1)), around)
    wall_angle = angle[border][step]
    moved = steady_random((len(step), 2), seed=2)
    # Creases of the outline stay where they are: only heights move where it has a corner, and elsewhere both.
    corner = has_corner(outline, angle[border])[step]
    wall_angle = wall_angle + np.where(corner, 0.0, moved[:, 0]) * 2 * np.pi / around
    level = (turn + 1 + moved[:, 1]) / layers * height
    radius = outline(wall_angle)
    wall = np.column_stack((radius * np.cos(wall_angle), radius * np.sin(wall_angle), level))
    bottom, top = (np.column_stack((end, np.full(count, z))) for z in (0.0, height))
    rows = np.concatenate(
        (border[None], 2 * count + np.arange(len(wall)).reshape(layers - 1, around), count + border[None])
    )
    wall_quads = quads_of(np.concatenate((rows, rows[:, :1]), axis=1))
    vertices = np.concatenate((bottom, top, wall)) - [0.0, 0.0, 0.5 * height]
    return vertices / half_size, np.concatenate((quads[:, ::-1], count + quads, wall_quads))


def has_corner(outline: Callable[[Floats], Floats], angle: Floats) -> NDArray[np.bool_]:
    step = 1e-4
    bend = (outline(angle + step) - 2 * outline(angle) + outline(angle - step)) / step
    return np.abs(bend) > 0.05


def disk_grid(cells: int, jitter: float) -> tuple[Floats, Integers, Integers]:
    """Map a square grid to the unit disk.

    Returns vertices (V, 2), quads wound counter-clockwise and starting on the diagonal that leads to the nearest corner
    of the square, and the border counter-clockwise at equal angles.
    """
    row, column = np.divmod(np.arange((cells + 1) ** 2), cells + 1)
    inside = (row > 0) & (row < cells) & (column > 0) & (column < cells)
    u, v = 2 * column / cells - 1.0, 2 * row / cells - 1.0
    shift = jitter / JITTER * steady_random((len(u), 2), seed=5) * inside[:, None] * 2 / cells
    u, v = u + shift[:, 0], v + shift[:, 1]
    # Squares around the middle become circles: the longer coordinate is the radius, the other runs along the arc.
    radius = np.maximum(np.abs(u), np.abs(v))
    share = np.divide(np.minimum(np.abs(u), np.abs(v)), radius, out=np.zeros_like(radius), where=radius > 0)
    angle = 0.25 * np.pi * share
    steep = np.abs(v) > np.abs(u)
    circle = np.column_stack(
        (np.where(steep, np.sin(angle), np.cos(angle)), np.where(steep, np.cos(angle), np.sin(angle)))
    )
    # Blend from the square itself in the middle to circles at the border: even cells all over.
    blend = radius[:, None] ** 2
    square = np.column_stack((np.abs(u), np.abs(v))) * 0.85
    disk = ((1 - blend) * square + blend * circle * radius[:, None]) * np.sign(np.column_stack((u, v)))
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    quads = np.stack((number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]), axis=-1).reshape(-1, 4)
    across, up = np.divmod(np.arange(cells * cells), cells)
    turn = (2 * across + 1 < cells) != (2 * up + 1 < cells)
    quads[turn] = np.roll(quads[turn], 1, axis=1)
    border = np.concatenate((number[0, :-1], number[:-1, -1], number[-1, :0:-1], number[:0:-1, 0]))
    return disk, quads, border


def geodesic_sphere(frequency: int, jitter: float) -> Model:
    """Split the faces of an icosahedron into frequency^2 triangles each and push the vertices out to the sphere."""
    base, base_faces = icosahedron()
    i, j = np.divmod(np.arange((frequency + 1) ** 2), frequency + 1)
    i, j = i[i + j <= frequency], j[i + j <= frequency]
    steps = np.column_stack((frequency - i - j, i, j))
    weights = np.zeros((len(base_faces), len(steps), 12), dtype=np.int64)
    for corner in range(3):
        face = np.arange(len(base_faces))[:, None]
        weights[face, np.arange(len(steps))[None], base_faces[:, corner][:, None]] += steps[:, corner]
    unique, number = np.unique(weights.reshape(-1, 12), axis=0, return_inverse=True)
    number = number.reshape(len(base_faces), len(steps))
    position = np.full((frequency + 1, frequency + 1), -1, dtype=np.int64)
    position[i, j] = np.arange(len(i))
    upright = position[:-1, :-1], position[1:, :-1], position[:-1, 1:]
    inverted = position[1:, :-1], position[1:, 1:], position[:-1, 1:]
    local = np.concatenate([np.stack(part, axis=-1).reshape(-1, 3) for part in (upright, inverted)])
    local = local[(local >= 0).all(axis=1)]
    points = unique @ base / frequency
    points += jitter / JITTER * steady_random(points.shape, seed=9) / frequency
    return points / np.linalg.norm(points, axis=1, keepdims=True), number[:, local].reshape(-1, 3)


def icosahedron() -> Model:
    golden = 0.5 * (1 + np.sqrt(5))
    signs = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) * [1, golden]
    flat = np.column_stack((np.zeros(4), signs))
    points = np.concatenate([np.roll(flat, axis, axis=1) for axis in range(3)])
    points /= np.linalg.norm(points[0])
    near = np.linalg.norm(points[:, None] - points[None], axis=2) < 1.1
    a, b, c = np.nonzero(near[:, :, None] & near[None] & near[:, None, :])
    faces = np.column_stack((a, b, c))
    faces = faces[(a < b) & (b < c)]
    inward = np.einsum("fx,fx->f", points[faces[:, 0]], np.cross(points[faces[:, 1]], points[faces[:, 2]])) < 0
    faces[inward] = faces[inward][:, [0, 2, 1]]
    return points, faces


def grid_quads(rows: int, columns: int, *, closed_columns: bool = False, closed_rows: bool = False) -> Integers:
    number = np.arange(rows * columns).reshape(rows, columns)
    if closed_columns:
        number = np.concatenate((number, number[:, :1]), axis=1)
    if closed_rows:
        number = np.concatenate((number, number[:1]))
    return quads_of(number)


def quads_of(number: Integers) -> Integers:
    """Return the quads between the rows and columns of a grid of vertex numbers."""
    corners = (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1])
    return np.stack(corners, axis=-1).reshape(-1, 4)


def alternating_triangles(vertices: Floats, quads: Integers) -> Integers:
    """Split quads along the diagonals between every other vertex of a mesh whose vertices take two colours.

    Where that would make a needle, the other diagonal is taken.
    """
    count = int(quads.max()) + 1
    ends = np.stack((quads, np.roll(quads, -1, axis=1)), axis=-1).reshape(-1, 2)
    graph = coo_array((np.ones(len(ends), dtype=np.int8), (ends[:, 0], ends[:, 1])), shape=(count, count)).tocsr()
    even = dijkstra(graph, directed=False, indices=0, unweighted=True)[quads[:, 0]] % 2 == 0
    first = np.where(even[:, None], quads, np.roll(quads, 1, axis=1))
    triangles, _ = triangulate(vertices, first.reshape(-1), 4 * np.arange(len(first) + 1))
    return triangles


def from_crest(plane: Floats, across: Floats, period: float) -> Floats:
    """Return the distance of points in the plane from the nearest of many gently winding lines, (V,)."""
    along = plane @ np.array([-across[1], across[0]])
    position = plane @ across + 6 * np.sin(along / 60)
    return (position + 0.5 * period) % period - 0.5 * period


def without_loose(vertices: Floats, faces: Integers) -> Model:
    used, renumbered = np.unique(faces, return_inverse=True)
    return vertices[used], renumbered.reshape(faces.shape)


def steady_random(shape: tuple[int, ...], seed: int) -> Floats:
    """Return numbers in [-JITTER, JITTER] that depend on nothing but the position and the seed."""
    number = np.arange(int(np.prod(shape)), dtype=np.uint64) + np.uint64(seed << 40)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB), (31, 1)):
        number = (number ^ (number >> np.uint64(shift))) * np.uint64(factor)
    return ((number >> np.uint64(11)).astype(np.float64) / 2.0**53 * 2 - 1).reshape(shape) * JITTER


def waves(points: Floats, frequencies: tuple[float, ...], amplitudes: tuple[float, ...], seed: int) -> Floats:
    """Return a sum of sine waves in several directions for each frequency, (V,)."""
    total = np.zeros(len(points))
    per_frequency = 5
    for level, (frequency, amplitude) in enumerate(zip(frequencies, amplitudes, strict=True)):
        random = steady_random((per_frequency, points.shape[1] + 1), seed=seed + 17 * level) / JITTER
        directions = random[:, :-1] / np.linalg.norm(random[:, :-1], axis=1, keepdims=True)
        total += amplitude / per_frequency * np.sin(frequency * points @ directions.T + 6 * random[:, -1]).sum(axis=1)
    return total

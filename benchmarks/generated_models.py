"""Generated models: those of the paper's Table 1, and shapes that are hard for one reason each.

Each function returns vertices (V, 3) and faces (F, n), wound outwards where the model is closed.  Vertices are moved a
little along the surface (never off it, and never off a crease), the same way every time: on a perfectly regular grid
some fits are accidentally exact.
"""

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

_JITTER = 0.18  # of a cell, to either side


# ------------------------------------------------------------------------------------------------- the paper's models


def cube(cells: int = 16) -> Model:
    """Return a cube of edge length 1 with `cells` x `cells` quads a side: 1,538 vertices, a regular grid."""
    vertices, faces = _box_surface(np.ones((cells, cells, cells), dtype=bool), jitter=0.0)
    return vertices / cells - 0.5, faces


def cubetorus() -> Model:
    """Return a square frame with a square section: 2,688 vertices, genus 1, creases only at right angles."""
    solid = np.ones((24, 24, 13), dtype=bool)
    solid[8:16, 8:16] = False
    vertices, faces = _box_surface(solid, jitter=_JITTER)
    return (vertices - [12.0, 12.0, 6.5]) / 24, faces


def cylinder() -> Model:
    """Return a capped cylinder, twice as high as wide: 2,732 vertices, two circular creases."""
    return _prism(15, 38, lambda angle: np.ones_like(angle), height=4.0, half_size=4.0)


def flower() -> Model:
    """Return an extruded flower of five petals: 7,922 vertices, creases between the petals and around both ends.

    Its triangles meet four or eight at a vertex.
    """
    vertices, quads = _prism(30, 51, lambda angle: 0.62 + 0.38 * np.abs(np.cos(2.5 * angle)), height=1.9, half_size=2.0)
    return vertices, _alternating_triangles(vertices, quads)


def detailed() -> Model:
    """Return a smooth body with fine relief: 56,252 vertices, in the place of the paper's Bird."""
    directions, faces = _geodesic_sphere(75, jitter=_JITTER)
    # Contiguous: NumPy may round functions of a strided row differently, as it happens to lie in memory.
    x, y, z = np.ascontiguousarray(directions.T)
    body = 1 + 0.25 * x * z + 0.15 * np.cos(2.4 * y + 0.5) - 0.2 * z**3
    relief = _waves(
        directions, frequencies=(4.0, 8.0, 15.0, 26.0, 40.0), amplitudes=(0.1, 0.1, 0.06, 0.03, 0.012), seed=7
    )
    stretched = directions * (body + relief)[:, None] * np.array([1.5, 0.8, 1.0])
    return stretched / np.ptp(stretched, axis=0).max(), faces


# ---------------------------------------------------------------------------------------------------- smooth and sharp


def sphere(frequency: int = 16) -> Model:
    """Return a sphere of radius 1: each icosahedron edge split into `frequency`, 10 frequency^2 + 2 vertices."""
    return _geodesic_sphere(frequency, jitter=0.0)


def lens(cells: int = 24) -> Model:
    """Return a lens of radius 1: two spherical caps that meet in one circular crease of changing neighbourhoods."""
    disk, quads, outline = _disk_grid(cells, jitter=_JITTER)
    count = len(disk)
    depth = 0.9  # distance from the middle plane to the centres of the two spheres
    rise = np.sqrt(1 + depth**2 - (disk**2).sum(axis=1)) - depth
    top = np.column_stack((disk, rise))
    bottom = np.column_stack((disk, -rise))
    number = count + np.arange(count)
    number[outline] = outline
    vertices = np.concatenate((top, bottom))
    vertices[outline, 2] = 0.0
    return _without_loose(vertices, np.concatenate((quads, number[quads[:, ::-1]])))


def l_solid(cells: int = 12) -> Model:
    """Return an L-shaped solid, longest side 1: flat faces, convex creases and one concave one."""
    solid = np.ones((2 * cells, 2 * cells, cells), dtype=bool)
    solid[cells:, cells:] = False
    vertices, faces = _box_surface(solid, jitter=_JITTER)
    return vertices / (2 * cells) - [0.5, 0.5, 0.25], faces


def creased_terrain(vertex_count: int = 1_000_000) -> Model:
    """Return an open terrain of about `vertex_count` vertices: hills, fine relief and sharp ridges in all directions.

    The distance between vertices is 1, so that patches look alike at every size.
    """
    side = max(round(vertex_count**0.5), 2)
    row, column = np.divmod(np.arange(side * side), side)
    plane = np.column_stack((column, row)) + 0.5 * _jitter((side * side, 2), seed=11)
    ridges = ((0.4, 41.0), (1.3, 53.0), (2.5, 67.0))  # direction across and distance between
    across = np.array([[np.cos(direction), np.sin(direction)] for direction, _ in ridges])
    off = np.array([_from_crest(plane, a, period) for a, (_, period) in zip(across, ridges, strict=True)])
    nearest = np.abs(off).argmin(axis=0)
    off = off[nearest, np.arange(len(plane))]
    plane -= np.where(np.abs(off) < 0.25, off, 0.0)[:, None] * across[nearest]
    height = 3.0 * _waves(plane, frequencies=(0.02, 0.05, 0.11, 0.23), amplitudes=(2.0, 0.8, 0.3, 0.1), seed=3)
    for a, (_, period) in zip(across, ridges, strict=True):
        height = np.maximum(height, 6.0 - 1.1 * np.abs(_from_crest(plane, a, period)))
    number = np.arange(side * side).reshape(side, side)
    a, b, c, d = _quads_of(number).T
    odd = (row + column)[a] % 2 == 1
    one = np.where(odd[:, None], np.column_stack((a, b, c)), np.column_stack((a, b, d)))
    two = np.where(odd[:, None], np.column_stack((a, c, d)), np.column_stack((b, c, d)))
    return np.column_stack((plane, height)), np.stack((one, two), axis=1).reshape(-1, 3)


# --------------------------------------------------------------------------------------------------- hard for patches


def tetrahedron() -> Model:
    """Return a regular tetrahedron: four vertices, the smallest closed mesh."""
    vertices = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    return vertices, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])


def cube98() -> Model:
    """Return a cube of 98 vertices: one 7-ring would wrap the whole of it."""
    return cube(4)


def tube(around: int = 6, along: int = 120) -> Model:
    """Return an open straight tube, thinner than a ring: `around` vertices in a turn, `along` turns."""
    angle = 2 * np.pi * np.arange(around) / around
    turn, step = np.divmod(np.arange(around * along), around)
    step_length = 2 * np.pi / around
    vertices = np.column_stack((np.cos(angle[step]), np.sin(angle[step]), step_length * turn))
    return vertices, _grid_quads(along, around, closed_columns=True)


def thin_torus(around: int = 6, along: int = 120) -> Model:
    """Return a torus whose tube is thinner than a ring: `around` vertices in a turn, `along` turns."""
    turn, step = np.divmod(np.arange(around * along), around)
    minor, major = 2 * np.pi * step / around, 2 * np.pi * turn / along
    radius = along / around
    vertices = np.column_stack(
        ((radius + np.cos(minor)) * np.cos(major), (radius + np.cos(minor)) * np.sin(major), np.sin(minor))
    )
    return vertices, _grid_quads(along, around, closed_columns=True, closed_rows=True)[:, ::-1]


def moebius(around: int = 90, across: int = 9) -> Model:
    """Return a Moebius strip of quads: one side, one border, no orientation."""
    turn, step = np.divmod(np.arange(around * across), across)
    angle, width = 2 * np.pi * turn / around, 0.8 * (step / (across - 1) - 0.5)
    radius = 1 + width * np.cos(angle / 2)
    vertices = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), width * np.sin(angle / 2)))
    number = np.arange(around * across).reshape(around, across)
    number = np.concatenate((number, number[:1, ::-1]))
    return vertices, _quads_of(number)


def klein_bottle(around: int = 60, across: int = 24) -> Model:
    """Return a Klein bottle (figure-eight immersion): closed, without orientation, crossing itself."""
    turn, step = np.divmod(np.arange(around * across), across)
    u, v = 2 * np.pi * turn / around, 2 * np.pi * (step + 0.5) / across
    radius = 2 + np.cos(u / 2) * np.sin(v) - np.sin(u / 2) * np.sin(2 * v)
    height = np.sin(u / 2) * np.sin(v) + np.cos(u / 2) * np.sin(2 * v)
    vertices = np.column_stack((radius * np.cos(u), radius * np.sin(u), height))
    number = np.arange(around * across).reshape(around, across)
    number = np.concatenate((number, number[:1, ::-1]))
    return vertices, _quads_of(np.concatenate((number, number[:, :1]), axis=1))


def pole(valence: int = 2000, rings: int = 10) -> Model:
    """Return a disk around a vertex of `valence` triangles, with `rings` rings of as many vertices."""
    ring, step = np.divmod(np.arange(valence * rings), valence)
    angle, radius = 2 * np.pi * step / valence, (ring + 1) / rings
    outer = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), 0.2 * np.cos(3 * angle) * radius**2))
    following = 1 + (np.arange(valence) + 1) % valence
    fan = np.column_stack((np.zeros(valence, dtype=np.int64), 1 + np.arange(valence), following))
    a, b, c, d = (1 + _grid_quads(rings, valence, closed_columns=True)).T
    wall = np.concatenate((np.column_stack((a, c, b)), np.column_stack((a, d, c))))
    return np.concatenate((np.zeros((1, 3)), outer)), np.concatenate((fan, wall))


def finger(length: int = 9, cells: int = 15) -> Model:
    """Return a flat square of quads out of whose middle cell a closed square tube of `length` quads rises."""
    row, column = np.divmod(np.arange((cells + 1) ** 2), cells + 1)
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    low, high = cells // 2, cells // 2 + 1
    foot = np.array([number[low, low], number[low, high], number[high, high], number[high, low]])
    plane = _quads_of(number)
    plane = plane[~(np.sort(plane, axis=1) == np.sort(foot)).all(axis=1)]
    flat = np.column_stack((column, row, np.zeros(len(row))))
    level, step = np.divmod(np.arange(4 * length), 4)
    tube = flat[foot][step] + np.column_stack((np.zeros((4 * length, 2)), level + 1.0))
    rows = np.concatenate((foot[None], len(flat) + np.arange(4 * length).reshape(length, 4)))
    walls = _quads_of(np.concatenate((rows, rows[:, :1]), axis=1))
    return np.concatenate((flat, tube)), np.concatenate((plane, walls, rows[-1:]))


MODELS: dict[str, Callable[[], Model]] = {
    "cube": cube,
    "cubetorus": cubetorus,
    "cylinder": cylinder,
    "flower": flower,
    "detailed": detailed,
}
"""The generated models of Table 1; Fandisk and Bunny are files."""


# ---------------------------------------------------------------------------------------------------------- the pieces


def _box_surface(solid: NDArray[np.bool_], jitter: float) -> Model:
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
    return vertices + jitter / _JITTER * _jitter(vertices.shape, seed=1) * free, faces


def _prism(cells: int, layers: int, outline: Callable[[Floats], Floats], height: float, half_size: float) -> Model:
    """Return a closed prism over the outline radius(angle): quads, `cells` across an end, `layers` in the wall."""
    disk, quads, border = _disk_grid(cells, jitter=_JITTER)
    count, around = len(disk), len(border)
    x, y = np.ascontiguousarray(disk.T)
    angle = np.arctan2(y, x)
    end = disk * outline(angle)[:, None]
    turn, step = np.divmod(np.arange(around * (layers - 1)), around)
    wall_angle = angle[border][step]
    moved = _jitter((len(step), 2), seed=2)
    # Creases of the outline stay where they are: only heights move where it has a corner, and elsewhere both.
    corner = _has_corner(outline, angle[border])[step]
    wall_angle = wall_angle + np.where(corner, 0.0, moved[:, 0]) * 2 * np.pi / around
    level = (turn + 1 + moved[:, 1]) / layers * height
    radius = outline(wall_angle)
    wall = np.column_stack((radius * np.cos(wall_angle), radius * np.sin(wall_angle), level))
    bottom, top = (np.column_stack((end, np.full(count, z))) for z in (0.0, height))
    rows = np.concatenate(
        (border[None], 2 * count + np.arange(len(wall)).reshape(layers - 1, around), count + border[None])
    )
    wall_quads = _quads_of(np.concatenate((rows, rows[:, :1]), axis=1))
    vertices = np.concatenate((bottom, top, wall)) - [0.0, 0.0, 0.5 * height]
    return vertices / half_size, np.concatenate((quads[:, ::-1], count + quads, wall_quads))


def _has_corner(outline: Callable[[Floats], Floats], angle: Floats) -> NDArray[np.bool_]:
    step = 1e-4
    bend = (outline(angle + step) - 2 * outline(angle) + outline(angle - step)) / step
    return np.abs(bend) > 0.05


def _disk_grid(cells: int, jitter: float) -> tuple[Floats, Integers, Integers]:
    """Map a square grid to the unit disk.

    Returns vertices (V, 2), quads wound counter-clockwise and starting on the diagonal that leads to the nearest corner
    of the square, and the border counter-clockwise at equal angles.
    """
    row, column = np.divmod(np.arange((cells + 1) ** 2), cells + 1)
    inside = (row > 0) & (row < cells) & (column > 0) & (column < cells)
    u, v = 2 * column / cells - 1.0, 2 * row / cells - 1.0
    shift = jitter / _JITTER * _jitter((len(u), 2), seed=5) * inside[:, None] * 2 / cells
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


def _geodesic_sphere(frequency: int, jitter: float) -> Model:
    """Split the faces of an icosahedron into frequency^2 triangles each and push the vertices out to the sphere."""
    base, base_faces = _icosahedron()
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
    points += jitter / _JITTER * _jitter(points.shape, seed=9) / frequency
    return points / np.linalg.norm(points, axis=1, keepdims=True), number[:, local].reshape(-1, 3)


def _icosahedron() -> Model:
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


def _grid_quads(rows: int, columns: int, *, closed_columns: bool = False, closed_rows: bool = False) -> Integers:
    number = np.arange(rows * columns).reshape(rows, columns)
    if closed_columns:
        number = np.concatenate((number, number[:, :1]), axis=1)
    if closed_rows:
        number = np.concatenate((number, number[:1]))
    return _quads_of(number)


def _quads_of(number: Integers) -> Integers:
    """Return the quads between the rows and columns of a grid of vertex numbers."""
    corners = (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1])
    return np.stack(corners, axis=-1).reshape(-1, 4)


def _alternating_triangles(vertices: Floats, quads: Integers) -> Integers:
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


def _from_crest(plane: Floats, across: Floats, period: float) -> Floats:
    """Return the distance of points in the plane from the nearest of many gently winding lines, (V,)."""
    along = plane @ np.array([-across[1], across[0]])
    position = plane @ across + 6 * np.sin(along / 60)
    return (position + 0.5 * period) % period - 0.5 * period


def _without_loose(vertices: Floats, faces: Integers) -> Model:
    used, renumbered = np.unique(faces, return_inverse=True)
    return vertices[used], renumbered.reshape(faces.shape)


def _jitter(shape: tuple[int, ...], seed: int) -> Floats:
    """Return numbers in [-_JITTER, _JITTER] that depend on nothing but the position and the seed."""
    number = np.arange(int(np.prod(shape)), dtype=np.uint64) + np.uint64(seed << 40)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB), (31, 1)):
        number = (number ^ (number >> np.uint64(shift))) * np.uint64(factor)
    return ((number >> np.uint64(11)).astype(np.float64) / 2.0**53 * 2 - 1).reshape(shape) * _JITTER


def _waves(points: Floats, frequencies: tuple[float, ...], amplitudes: tuple[float, ...], seed: int) -> Floats:
    """Return a sum of sine waves in several directions for each frequency, (V,)."""
    total = np.zeros(len(points))
    per_frequency = 5
    for level, (frequency, amplitude) in enumerate(zip(frequencies, amplitudes, strict=True)):
        random = _jitter((per_frequency, points.shape[1] + 1), seed=seed + 17 * level) / _JITTER
        directions = random[:, :-1] / np.linalg.norm(random[:, :-1], axis=1, keepdims=True)
        total += amplitude / per_frequency * np.sin(frequency * points @ directions.T + 6 * random[:, -1]).sum(axis=1)
    return total

"""Generated models: those of the paper's Table 1, and shapes that are hard for one reason each.

Each function returns vertices (V, 3) and faces (F, n), wound outwards where the model is closed.  Vertices are moved a
little along the surface (never off it, and never off a crease), the same way every time: on a perfectly regular grid
some fits are accidentally exact.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .model_pieces import (
    JITTER,
    Model,
    alternating_triangles,
    box_surface,
    disk_grid,
    from_crest,
    geodesic_sphere,
    grid_quads,
    prism,
    quads_of,
    steady_random,
    waves,
    without_loose,
)

# ------------------------------------------------------------------------------------------------- the paper's models


def cube(cells: int = 16) -> Model:
    """Return a cube of edge length 1 with `cells` x `cells` quads a side: 1,538 vertices, a regular grid."""
    vertices, faces = box_surface(np.ones((cells, cells, cells), dtype=bool), jitter=0.0)
    return vertices / cells - 0.5, faces


def cubetorus() -> Model:
    """Return a square frame with a square section: 2,688 vertices, genus 1, creases only at right angles."""
    solid = np.ones((24, 24, 13), dtype=bool)
    solid[8:16, 8:16] = False
    vertices, faces = box_surface(solid, jitter=JITTER)
    return (vertices - [12.0, 12.0, 6.5]) / 24, faces


def cylinder() -> Model:
    """Return a capped cylinder, twice as high as wide: 2,732 vertices, two circular creases."""
    return prism(15, 38, lambda angle: np.ones_like(angle), height=4.0, half_size=4.0)


def flower() -> Model:
    """Return an extruded flower of five petals: 7,922 vertices, creases between the petals and around both ends.

    Its triangles meet four or eight at a vertex.
    """
    vertices, quads = prism(30, 51, lambda angle: 0.62 + 0.38 * np.abs(np.cos(2.5 * angle)), height=1.9, half_size=2.0)
    return vertices, alternating_triangles(vertices, quads)


def detailed() -> Model:
    """Return a smooth body with fine relief: 56,252 vertices, in the place of the paper's Bird."""
    directions, faces = geodesic_sphere(75, jitter=JITTER)
    # Contiguous: NumPy may round functions of a strided row differently, as it happens to lie in memory.
    x, y, z = np.ascontiguousarray(directions.T)
    body = 1 + 0.25 * x * z + 0.15 * np.cos(2.4 * y + 0.5) - 0.2 * z**3
    relief = waves(
        directions, frequencies=(4.0, 8.0, 15.0, 26.0, 40.0), amplitudes=(0.1, 0.1, 0.06, 0.03, 0.012), seed=7
    )
    stretched = directions * (body + relief)[:, None] * np.array([1.5, 0.8, 1.0])
    return stretched / np.ptp(stretched, axis=0).max(), faces


# ---------------------------------------------------------------------------------------------------- smooth and sharp


def sphere(frequency: int = 16) -> Model:
    """Return a sphere of radius 1: each icosahedron edge split into `frequency`, 10 frequency^2 + 2 vertices."""
    return geodesic_sphere(frequency, jitter=0.0)


def lens(cells: int = 24) -> Model:
    """Return a lens of radius 1: two spherical caps that meet in one circular crease of changing neighbourhoods."""
    disk, quads, outline = disk_grid(cells, jitter=JITTER)
    count = len(disk)
    depth = 0.9  # distance from the middle plane to the centres of the two spheres
    rise = np.sqrt(1 + depth**2 - (disk**2).sum(axis=1)) - depth
    top = np.column_stack((disk, rise))
    bottom = np.column_stack((disk, -rise))
    number = count + np.arange(count)
    number[outline] = outline
    vertices = np.concatenate((top, bottom))
    vertices[outline, 2] = 0.0
    return without_loose(vertices, np.concatenate((quads, number[quads[:, ::-1]])))


def l_solid(cells: int = 12) -> Model:
    """Return an L-shaped solid, longest side 1: flat faces, convex creases and one concave one."""
    solid = np.ones((2 * cells, 2 * cells, cells), dtype=bool)
    solid[cells:, cells:] = False
    vertices, faces = box_surface(solid, jitter=JITTER)
    return vertices / (2 * cells) - [0.5, 0.5, 0.25], faces


def creased_terrain(vertex_count: int = 1_000_000) -> Model:
    """Return an open terrain of about `vertex_count` vertices: hills, fine relief and sharp ridges in all directions.

    The distance between vertices is 1, so that patches look alike at every size.
    """
    side = max(round(vertex_count**0.5), 2)
    row, column = np.divmod(np.arange(side * side), side)
    plane = np.column_stack((column, row)) + 0.5 * steady_random((side * side, 2), seed=11)
    ridges = ((0.4, 41.0), (1.3, 53.0), (2.5, 67.0))  # direction across and distance between
    across = np.array([[np.cos(direction), np.sin(direction)] for direction, _ in ridges])
    off = np.array([from_crest(plane, a, period) for a, (_, period) in zip(across, ridges, strict=True)])
    nearest = np.abs(off).argmin(axis=0)
    off = off[nearest, np.arange(len(plane))]
    plane -= np.where(np.abs(off) < 0.25, off, 0.0)[:, None] * across[nearest]
    height = 3.0 * waves(plane, frequencies=(0.02, 0.05, 0.11, 0.23), amplitudes=(2.0, 0.8, 0.3, 0.1), seed=3)
    for a, (_, period) in zip(across, ridges, strict=True):
        height = np.maximum(height, 6.0 - 1.1 * np.abs(from_crest(plane, a, period)))
    number = np.arange(side * side).reshape(side, side)
    a, b, c, d = quads_of(number).T
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
    return vertices, grid_quads(along, around, closed_columns=True)


def thin_torus(around: int = 6, along: int = 120) -> Model:
    """Return a torus whose tube is thinner than a ring: `around` vertices in a turn, `along` turns."""
    turn, step = np.divmod(np.arange(around * along), around)
    minor, major = 2 * np.pi * step / around, 2 * np.pi * turn / along
    radius = along / around
    vertices = np.column_stack(
        ((radius + np.cos(minor)) * np.cos(major), (radius + np.cos(minor)) * np.sin(major), np.sin(minor))
    )
    return vertices, grid_quads(along, around, closed_columns=True, closed_rows=True)[:, ::-1]


def moebius(around: int = 90, across: int = 9) -> Model:
    """Return a Moebius strip of quads: one side, one border, no orientation."""
    turn, step = np.divmod(np.arange(around * across), across)
    angle, width = 2 * np.pi * turn / around, 0.8 * (step / (across - 1) - 0.5)
    radius = 1 + width * np.cos(angle / 2)
    vertices = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), width * np.sin(angle / 2)))
    number = np.arange(around * across).reshape(around, across)
    number = np.concatenate((number, number[:1, ::-1]))
    return vertices, quads_of(number)


def klein_bottle(around: int = 60, across: int = 24) -> Model:
    """Return a Klein bottle (figure-eight immersion): closed, without orientation, crossing itself."""
    turn, step = np.divmod(np.arange(around * across), across)
    u, v = 2 * np.pi * turn / around, 2 * np.pi * (step + 0.5) / across
    radius = 2 + np.cos(u / 2) * np.sin(v) - np.sin(u / 2) * np.sin(2 * v)
    height = np.sin(u / 2) * np.sin(v) + np.cos(u / 2) * np.sin(2 * v)
    vertices = np.column_stack((radius * np.cos(u), radius * np.sin(u), height))
    number = np.arange(around * across).reshape(around, across)
    number = np.concatenate((number, number[:1, ::-1]))
    return vertices, quads_of(np.concatenate((number, number[:, :1]), axis=1))


def pole(valence: int = 2000, rings: int = 10) -> Model:
    """Return a disk around a vertex of `valence` triangles, with `rings` rings of as many vertices."""
    ring, step = np.divmod(np.arange(valence * rings), valence)
    angle, radius = 2 * np.pi * step / valence, (ring + 1) / rings
    outer = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), 0.2 * np.cos(3 * angle) * radius**2))
    following = 1 + (np.arange(valence) + 1) % valence
    fan = np.column_stack((np.zeros(valence, dtype=np.int64), 1 + np.arange(valence), following))
    a, b, c, d = (1 + grid_quads(rings, valence, closed_columns=True)).T
    wall = np.concatenate((np.column_stack((a, c, b)), np.column_stack((a, d, c))))
    return np.concatenate((np.zeros((1, 3)), outer)), np.concatenate((fan, wall))


def finger(length: int = 9, cells: int = 15) -> Model:
    """Return a flat square of quads out of whose middle cell a closed square tube of `length` quads rises."""
    row, column = np.divmod(np.arange((cells + 1) ** 2), cells + 1)
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    low, high = cells // 2, cells // 2 + 1
    foot = np.array([number[low, low], number[low, high], number[high, high], number[high, low]])
    plane = quads_of(number)
    plane = plane[~(np.sort(plane, axis=1) == np.sort(foot)).all(axis=1)]
    flat = np.column_stack((column, row, np.zeros(len(row))))
    level, step = np.divmod(np.arange(4 * length), 4)
    tube = flat[foot][step] + np.column_stack((np.zeros((4 * length, 2)), level + 1.0))
    rows = np.concatenate((foot[None], len(flat) + np.arange(4 * length).reshape(length, 4)))
    walls = quads_of(np.concatenate((rows, rows[:, :1]), axis=1))
    return np.concatenate((flat, tube)), np.concatenate((plane, walls, rows[-1:]))


MODELS: dict[str, Callable[[], Model]] = {
    "cube": cube,
    "cubetorus": cubetorus,
    "cylinder": cylinder,
    "flower": flower,
    "detailed": detailed,
}
"""The generated models of Table 1; Fandisk and Bunny are files."""

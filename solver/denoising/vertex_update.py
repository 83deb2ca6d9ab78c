"""Moving vertices to where the patches around them meet."""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Booleans, Indices
from ..mesh.normals import normals_and_areas, normals_around, unit
from .surface import Surface

LARGEST_MOVE = 3.5
"""Noise levels that a vertex moves at most ..."""

WILD_MOVE = 12.0
"""... unless there are more wild vertices, off by more than that, than Gaussian noise has."""

LEAST_VARIANCE = 1e-8
"""Of the squared longest move: patches never agree better than that about where they are."""

_WILD_SHARE = 0.004  # of the vertices; Gaussian noise has 0.0005, and 0.002 where its level is told 12 % too low
_FEWEST_WILD = 6

_ALONG = 1e-3
_ACROSS = 0.15  # resistance to sliding along the surface; the planes of a crease of 60 degrees weigh 0.25
_FILLING_STEPS = 10
_SETTLING_STEPS = 20
_LEANING = 0.16  # as patches bear of a triangle's normal
_SHAPE_ROUNDS = 2  # of means over the triangles around: how far what patches level out reaches
_TRIANGLES_AROUND = 6  # a vertex: the same patches tell how they lean, so that together they count as one


def move_to_planes(
    vertices: Array,
    planes: tuple[Array, Array, Array],
    directions: Array,
    noise_level: float,
    largest: float = LARGEST_MOVE,
) -> Array:
    """Return the vertices moved onto the planes that patches give for them.

    Minimises over the move x: mean of (n . x - d)^2 over a vertex's planes, plus a small multiple of the square of the
    part of x across `directions`.  On a smooth surface a vertex moves along its normal; on a crease to the crease; in
    a corner to the corner.

    Parameters
    ----------
    vertices
        (V, 3).
    planes
        Mean of n n^T (V, 3, 3), of n d (V, 3), and weight (V,); see `PatchAverage.planes`.
    directions
        Unit normals at the vertices, (V, 3).
    noise_level
        Standard deviation of the noise along the normals.
    largest
        Moves are at most this many noise levels long.
    """
    matrices, targets, weight = planes
    known = np.flatnonzero(weight > 0)
    direction = directions[known]
    across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    resistance = _ACROSS * across + _ALONG * np.eye(3)
    solved = np.linalg.solve(matrices[known] + resistance, targets[known][..., None])[..., 0]
    moves = np.asarray(solved, dtype=np.float64)
    moved = vertices.copy()
    moved[known] += limited(moves, largest * noise_level)
    return moved


def move_wild_ones_far(
    vertices: Array, planes: tuple[Array, Array, Array], directions: Array, noise_level: float, known_level: float
) -> tuple[Array, float]:
    """Return what `move_to_planes` does, and the longest move: long where vertices are wild by the `known_level`."""
    far = move_to_planes(vertices, planes, directions, noise_level, WILD_MOVE)
    largest = WILD_MOVE if has_wild_vertices(far - vertices, known_level) else LARGEST_MOVE
    return move_to_planes(vertices, planes, directions, noise_level, largest), largest * noise_level


def has_wild_vertices(moves: Array, noise_level: float) -> bool:
    """Return whether more of the moves, (V, 3), are far longer than the noise level than Gaussian noise explains."""
    wild = int((np.linalg.norm(moves, axis=1) > LARGEST_MOVE * noise_level).sum())
    return wild > _WILD_SHARE * len(moves) + _FEWEST_WILD


def fill_in(vertices: Array, moved: Array, known: Booleans, surface: Surface, normals: Array, limit: float) -> Array:
    """Move the vertices that no patch reached after their neighbours, towards the planes of the triangles around them.

    The ordinary vertex update (Sun, Rosin, Martin and Langbein, TVCG 2007), held to vertices beside known ones.

    Parameters
    ----------
    vertices, moved
        Positions before, and with the `known` ones moved, (V, 3).
    known
        Vertices that have their final position, (V,).
    surface, normals
        The mesh and the filtered normals of its triangles, (T, 3).
    limit
        Longest move.
    """
    triangles = surface.triangles
    beside = np.zeros(len(vertices), dtype=bool)
    beside[triangles[known[triangles].any(axis=1)]] = True
    return follow_normals(vertices, moved, beside & ~known, surface, normals, limit, _FILLING_STEPS)


def follow_normals(
    vertices: Array, moved: Array, loose: Booleans, surface: Surface, normals: Array, limit: float, steps: int
) -> Array:
    """Move the `loose` vertices, (V,), a few steps towards the planes of the triangles around them; see `fill_in`."""
    triangles = surface.triangles
    touching = np.flatnonzero(loose[triangles].any(axis=1))
    if not len(touching):
        return moved
    corners = triangles[touching].ravel()
    normal = np.repeat(normals[touching], 3, axis=0)
    count = np.maximum(np.bincount(corners, minlength=len(vertices)), 1)
    result = moved.copy()
    for _ in range(steps):
        centroids = np.repeat(result[triangles[touching]].mean(axis=1), 3, axis=0)
        to_plane = normal * (normal * (centroids - result[corners])).sum(axis=1, keepdims=True)
        total = np.stack([np.bincount(corners, to_plane[:, axis], len(vertices)) for axis in range(3)], axis=1)
        step = (total / count[:, None])[loose]
        result[loose] = vertices[loose] + limited(result[loose] + step - vertices[loose], limit)
    return result


def settle(
    vertices: Array,
    moved: Array,
    directions: Array,
    stiffness: Array,
    surface: Surface,
    leaning: tuple[Array, Array],
    limit: float,
) -> Array:
    """Move vertices along their normals until the triangles between them lean as the patches say.

    Each vertex lies on the mean of its own patches, which differs a little from that of its neighbours' patches; the
    mean of the patches' slopes is free of these differences.  Minimises the squared changes of the vertices' heights
    and the squared distances of the triangles' corners from planes of the known normals, each over the variance that
    the patches show.  Where a triangle leans otherwise by far, patches of two sides of a crease are mixed in its
    normal, and it loses its weight (Welsch).  Nothing slides along the surface: creases would follow wrong normals.

    Parameters
    ----------
    vertices, moved
        Positions before, and on their planes, (V, 3).
    directions
        Unit normals at the vertices, (V, 3).
    stiffness
        One over the variance of each vertex's height, (V,); infinite where it stays.
    surface
        The mesh.
    leaning
        The patches' normals of the triangles, (T, 3), and their variances along a tangent, (T,).
    limit
        Longest move.
    """
    triangles, (normals, variances) = surface.triangles, leaning
    corners = moved[triangles]
    heights = np.einsum("tc,tkc->tk", normals, corners)
    across = np.einsum("tc,tkc->tk", normals, directions[triangles])
    extents = ((corners - corners.mean(axis=1, keepdims=True)) ** 2).sum(axis=(1, 2)) / 3
    trust = _likeness(normals_and_areas(moved, triangles)[0], normals)
    trust /= np.maximum(variances * extents, LEAST_VARIANCE * limit**2) * _TRIANGLES_AROUND

    def at_vertices(values: Array) -> Array:
        """Return the sum of the corners' values, (T, 3), around each vertex."""
        total = np.zeros(len(vertices))
        for corner in range(3):
            total += np.bincount(triangles[:, corner], values[:, corner], len(vertices))
        return total

    held = np.maximum(stiffness + at_vertices(trust[:, None] * across**2), 1e-300)
    change = np.zeros(len(vertices))
    for _ in range(_SETTLING_STEPS):
        planes = (heights + across * change[triangles]).mean(axis=1, keepdims=True)
        change = at_vertices(trust[:, None] * across * (planes - heights)) / held
    settled = vertices + limited(moved + change[:, None] * directions - vertices, limit)
    return np.where((change == 0.0)[:, None], moved, settled)


def keep_shape(moved: Array, surface: Surface, leaning: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return how triangles shall lean, (T, 3), as patches say it but for what they level out, and variances, (T,).

    Patches level out what is smaller than they are: there all triangles around lean otherwise than the patches say, and
    that is shape.  Only what changes from one triangle to the next comes from the heights of different patches.  The
    square of what is kept counts as variance, since patches that miss shape are not exact elsewhere.

    Parameters
    ----------
    moved
        The vertices, (V, 3).
    surface
        The mesh.
    leaning
        The patches' normals of the triangles, (T, 3), and their variances along a tangent, (T,).
    """
    normals, variances = leaning
    actual, areas = normals_and_areas(moved, surface.triangles)
    weights, kept = areas * _likeness(actual, normals), actual - normals
    for _ in range(_SHAPE_ROUNDS):
        kept = _mean_around(kept, weights, surface.triangles, len(moved))
    return unit(normals + kept), variances + (kept**2).sum(axis=1) / 2


def _likeness(actual: Array, normals: Array) -> Array:
    """Return the weights of triangles with these normals, (T,) (Welsch): little where they lean otherwise by far."""
    likeness: Array = np.exp(((actual - normals) ** 2).sum(axis=1) / (-2 * _LEANING**2))
    return likeness


def _mean_around(values: Array, weights: Array, triangles: Indices, vertex_count: int) -> Array:
    """Return the mean of the values (T, 3) of the triangles around the corners of each."""
    rows = np.column_stack((values * weights[:, None], weights))
    total = np.zeros((vertex_count, rows.shape[1]))
    for corner in range(3):
        for column, row in zip(total.T, rows.T, strict=True):
            column += np.bincount(triangles[:, corner], row, vertex_count)
    means = total[:, :3] / np.maximum(total[:, 3], 1e-300)[:, None]
    around: Array = means[triangles].mean(axis=1)
    return around


def update_directions(normals: Array, areas: Array, surface: Surface, vertex_count: int) -> Array:
    """Return the unit normals of vertices, (V, 3), from the filtered normals of the triangles, (T, 3)."""
    return normals_around(normals * np.sqrt(areas)[:, None], surface.triangles, vertex_count)


def limited(moves: Array, longest: float) -> Array:
    """Return the moves, shortened to `longest` where they are longer."""
    length = np.linalg.norm(moves, axis=1, keepdims=True)
    return np.where(length > longest, unit(moves) * longest, moves)

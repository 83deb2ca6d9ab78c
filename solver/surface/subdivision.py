"""Splitting the faces of a mesh: every edge into N parts, triangles and quads into N^2 faces each.

A quad is a grid over the square of its corners, each half of which lies in one of the quad's two triangles; larger
polygons are split triangle by triangle.  Neighbours share the new vertices of their edge.
"""

from __future__ import annotations

from collections.abc import Sized
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..arrays import Array, Indices, offsets_of, row_positions
from ..mesh.edges import edge_keys


class Polygons(Protocol):
    """The faces of a mesh and their triangles, as a `Representation` has them."""

    @property
    def vertices(self) -> Sized:
        """One row for each vertex."""

    @property
    def face_offsets(self) -> Indices:
        """Where each face's corners begin, (F + 1,)."""

    @property
    def face_corners(self) -> Indices:
        """Vertices of the faces, one face after the other."""

    @property
    def triangles(self) -> Indices:
        """Corners of the triangles, (T, 3)."""

    @property
    def polygon(self) -> Indices:
        """The face that each triangle lies in, (T,)."""


@dataclass(frozen=True)
class _Cells:
    """What is split as one piece: triangles of the source, or quads that consist of two of them.

    Attributes
    ----------
    face
        Input face of each cell, (n,).
    corners
        Vertices, (n, 3) or (n, 4).
    triangles
        Mesh triangles, (n, 1) or (n, 2).
    place
        Which of the cell's corners each triangle corner is, (n, 1 or 2, 3).
    """

    face: Indices
    corners: Indices
    triangles: Indices
    place: Indices


def _cells_of(source: Polygons, splits: int) -> tuple[_Cells, _Cells, Indices]:
    """Quads, triangles of all other faces, and the faces that stay in one piece."""
    count = len(source.face_offsets) - 1
    sizes = np.diff(source.face_offsets)
    collapsed = (source.triangles == np.roll(source.triangles, 1, axis=1)).any(axis=1)
    usable = np.bincount(source.polygon[~collapsed], minlength=count)
    # Where nothing is split larger faces need not become triangles.
    whole = (sizes > 4) & (usable > 0) if splits == 1 else np.zeros(count, dtype=bool)
    quads = _quads_of(source, np.flatnonzero((sizes == 4) & (usable == 2)))
    taken = collapsed | whole[source.polygon]
    taken[quads.triangles] = True
    free = np.flatnonzero(~taken)
    place = np.broadcast_to(np.arange(3), (len(free), 1, 3))
    return quads, _Cells(source.polygon[free], source.triangles[free], free[:, None], place), np.flatnonzero(whole)


def _quads_of(source: Polygons, face: Indices) -> _Cells:
    """Those of the faces, all with four corners and two triangles, whose triangles lie on both sides of a diagonal."""
    corners = source.face_corners[source.face_offsets[face][:, None] + np.arange(4)]
    order = np.argsort(source.polygon, kind="stable")
    triangles = order[np.searchsorted(source.polygon[order], face)[:, None] + np.arange(2)]
    same = source.triangles[triangles][..., None] == corners[:, None, None, :]
    place = same.argmax(axis=3)
    left_out = 6 - place.sum(axis=2)
    halves = (left_out[:, 0] + 2) % 4 == left_out[:, 1]
    ascending = np.sort(corners, axis=1)
    distinct = (ascending[:, 1:] != ascending[:, :-1]).all(axis=1)
    good = np.flatnonzero(halves & distinct & same.any(axis=3).all(axis=(1, 2)))
    return _Cells(face[good], corners[good], triangles[good], place[good])


@dataclass(frozen=True)
class _Edges:
    """Numbers of the edges around the cells; those of the source's faces come first.

    Attributes
    ----------
    pairs
        Vertices of the source's edges, (E, 2), the smaller one first.
    count
        Number of edges, with the diagonals between the triangles of a face.
    of_quads, of_triangles
        Edge from each corner of the cells to the next, (n, 4) and (n, 3).
    """

    pairs: Indices
    count: int
    of_quads: Indices
    of_triangles: Indices


def _edges_of(source: Polygons, quads: _Cells, triangles: _Cells, whole: Indices) -> _Edges:
    """Number the edges.

    A diagonal may join the same two vertices as an edge elsewhere, and still be another curve: it gets its own number.
    """
    vertices = len(source.vertices)
    face_pairs = edge_keys(source.face_corners, _next_corner(source), vertices)
    sides = [edge_keys(cells.corners, np.roll(cells.corners, -1, axis=1), vertices) for cells in (quads, triangles)]
    names, number = np.unique(np.concatenate([face_pairs, *(side.ravel() for side in sides)]), return_inverse=True)
    of_faces, of_quads, of_triangles = np.split(number, np.cumsum([len(face_pairs), sides[0].size]))
    of_quads, of_triangles = of_quads.reshape(-1, 4), of_triangles.reshape(-1, 3)
    face = np.repeat(np.arange(len(source.face_offsets) - 1), np.diff(source.face_offsets))
    own = triangles.face[:, None] * len(names) + of_triangles
    is_diagonal = ~np.isin(own, face * len(names) + of_faces)
    of_whole = of_faces[np.isin(face, whole)]
    used = np.unique(np.concatenate([of_quads.ravel(), of_triangles[~is_diagonal], of_whole]))
    diagonals = np.unique(own[is_diagonal])
    return _Edges(
        np.stack(np.divmod(names[used], vertices), axis=1),
        len(used) + len(diagonals),
        np.searchsorted(used, of_quads),
        np.where(is_diagonal, len(used) + np.searchsorted(diagonals, own), np.searchsorted(used, of_triangles)),
    )


def _next_corner(source: Polygons) -> Indices:
    """Vertex of the corner that follows each face corner."""
    following = np.arange(1, len(source.face_corners) + 1)
    filled = np.diff(source.face_offsets) > 0
    following[source.face_offsets[1:][filled] - 1] = source.face_offsets[:-1][filled]
    return source.face_corners[following]


@dataclass(frozen=True)
class _Pattern:
    """How a triangle or a quad is split.

    Attributes
    ----------
    steps
        Whole-numbered coordinates of the Q samples, (Q, 2): for a triangle steps towards its second and third corner,
        for a quad steps towards its second and fourth.
    sides
        Samples along each side, (3 or 4, N + 1).
    inner
        Samples that lie on no side.
    faces
        Samples at the new faces' corners, (N^2, 3 or 4).
    """

    steps: Indices
    sides: Indices
    inner: Indices
    faces: Indices


def _triangle_pattern(n: int) -> _Pattern:
    steps = np.array([(i, j) for j in range(n + 1) for i in range(n + 1 - j)])
    up = np.array([[(i, j), (i + 1, j), (i, j + 1)] for i, j in steps if i + j < n])
    down = np.array([[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i, j in steps if i + j < n - 1])
    down = down.reshape(-1, 3, 2).astype(np.int64)
    k = np.arange(n + 1)
    sides = np.stack([np.stack([k, 0 * k], 1), np.stack([n - k, k], 1), np.stack([0 * k, n - k], 1)])
    return _numbered(n, steps, sides, np.concatenate([up, down]))


def _quad_pattern(n: int) -> _Pattern:
    steps = np.array([(i, j) for j in range(n + 1) for i in range(n + 1)])
    faces = np.array([[(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)] for j in range(n) for i in range(n)])
    k = np.arange(n + 1)
    there, back = np.stack([k, 0 * k], 1), np.stack([n - k, 0 * k + n], 1)
    up, down = np.stack([0 * k + n, k], 1), np.stack([0 * k, n - k], 1)
    return _numbered(n, steps, np.stack([there, up, back, down]), faces)


def _numbered(n: int, steps: Indices, sides: Indices, faces: Indices) -> _Pattern:
    """Replace coordinates by numbers of samples."""
    number = np.zeros((n + 1, n + 1), dtype=np.int64)
    number[tuple(steps.T)] = np.arange(len(steps))
    on_sides = number[sides[..., 0], sides[..., 1]]
    inner = np.setdiff1d(np.arange(len(steps)), on_sides)
    return _Pattern(steps, on_sides, inner, number[faces[..., 0], faces[..., 1]])


@dataclass(frozen=True)
class Grid:
    """New faces of some cells.

    Attributes
    ----------
    triangle, inside
        Mesh triangle and barycentric coordinates of each sample, (Q,) and (Q, 3).
    vertex
        New vertex of each sample, (Q,).
    corners, sizes
        Samples at the faces' corners, (L,), and the number of each face's corners, (F,).
    face
        Input face of each face, (F,).
    """

    triangle: Indices
    inside: Array
    vertex: Indices
    corners: Indices
    sizes: Indices
    face: Indices


def _grid(cells: _Cells, pattern: _Pattern, sides: Indices, first_inner: int, at: tuple[Indices, Array]) -> Grid:
    """Put the pattern on every cell.

    Parameters
    ----------
    sides
        Vertices along the cells' sides, (n, 3 or 4, N + 1).
    first_inner
        Number of the first vertex inside of a cell.
    at
        Mesh triangles and barycentric coordinates of the samples, (n, Q) and (n, Q, 3).
    """
    count, samples = len(cells.face), len(pattern.steps)
    vertex = np.empty((count, samples), dtype=np.int64)
    vertex[:, pattern.sides] = sides
    inner = len(pattern.inner)
    vertex[:, pattern.inner] = first_inner + np.arange(count * inner).reshape(count, inner)
    corners = np.arange(count)[:, None, None] * samples + pattern.faces
    new_faces, size = pattern.faces.shape
    return Grid(
        at[0].ravel(),
        at[1].reshape(-1, 3),
        vertex.ravel(),
        corners.ravel(),
        np.full(count * new_faces, size),
        np.repeat(cells.face, new_faces),
    )


def _in_triangles(cells: _Cells, pattern: _Pattern, n: int) -> tuple[Indices, Array]:
    """Where the samples of split triangles lie, (n, Q) and (n, Q, 3)."""
    i, j = pattern.steps.T
    inside = np.stack([n - i - j, i, j], axis=1) / n
    shape = (len(cells.face), len(pattern.steps))
    return np.broadcast_to(cells.triangles, shape), np.broadcast_to(inside, (*shape, 3))


def _in_quads(cells: _Cells, pattern: _Pattern, n: int) -> tuple[Indices, Array]:
    """Where the samples of split quads lie: the square is bent along the diagonal between the two triangles."""
    i, j = pattern.steps.T
    nothing = 0 * i
    # Weights of the four corners, and the corner that the sample's half leaves out, for the diagonals 0-2 and 1-3.
    right, left = np.stack([n - i, i - j, j, nothing], 1), np.stack([n - j, nothing, i, j - i], 1)
    lower, upper = np.stack([n - i - j, i, nothing, j], 1), np.stack([nothing, n - j, i + j - n, n - i], 1)
    weights = np.stack([np.where((i >= j)[:, None], right, left), np.where((i + j <= n)[:, None], lower, upper)]) / n
    left_out = np.stack([np.where(i >= j, 3, 1), np.where(i + j <= n, 2, 0)])
    of_first = 6 - cells.place[:, 0].sum(axis=1)
    diagonal = np.where(of_first % 2 == 1, 0, 1)
    half = (left_out[diagonal] != of_first[:, None]).astype(np.int64)
    row = np.arange(len(cells.face))[:, None]
    sample = np.arange(len(pattern.steps))
    inside = weights[diagonal[:, None, None], sample[:, None], cells.place[row, half]]
    return cells.triangles[row, half], inside


def _whole_faces(source: Polygons, faces: Indices) -> Grid:
    """Faces as they are, with a sample at each corner."""
    rows, offsets = row_positions(source.face_offsets, faces)
    vertex = source.face_corners[rows]
    sizes = np.diff(offsets)
    corner_of = source.polygon[:, None] * len(source.vertices) + source.triangles
    order = np.argsort(corner_of, axis=None, kind="stable")
    at = order[np.searchsorted(corner_of.ravel()[order], np.repeat(faces, sizes) * len(source.vertices) + vertex)]
    return Grid(at // 3, np.eye(3)[at % 3], vertex, np.arange(len(rows)), sizes, faces)


def subdivided(source: Polygons, splits: int) -> tuple[Grid, Indices, Indices, int]:
    """The joined grid, the source's edges, the vertices on each of them, and the number of vertices."""
    quads, triangles, whole = _cells_of(source, splits)
    edges = _edges_of(source, quads, triangles, whole)
    between = splits - 1
    vertices = len(source.vertices)

    def along(starts: Indices, ends: Indices, edge: Indices) -> Indices:
        step = np.where((starts < ends)[..., None], np.arange(between), np.arange(between)[::-1])
        return np.concatenate(
            [starts[..., None], vertices + edge[..., None] * between + step, ends[..., None]], axis=-1
        )

    first_inner = vertices + edges.count * between
    grids = []
    for cells, pattern, of_cells, locate in (
        (quads, _quad_pattern(splits), edges.of_quads, _in_quads),
        (triangles, _triangle_pattern(splits), edges.of_triangles, _in_triangles),
    ):
        sides = along(cells.corners, np.roll(cells.corners, -1, axis=1), of_cells)
        grids.append(_grid(cells, pattern, sides, first_inner, locate(cells, pattern, splits)))
        first_inner += len(cells.face) * len(pattern.inner)
    joined = _joined([*grids, _whole_faces(source, whole)])
    chains = along(edges.pairs[:, 0], edges.pairs[:, 1], np.arange(len(edges.pairs)))
    return joined, edges.pairs, chains, first_inner


def _joined(grids: list[Grid]) -> Grid:
    """One grid, its faces in the order of the input's faces."""
    before = offsets_of(np.array([len(grid.vertex) for grid in grids]))
    corners = np.concatenate([grid.corners + start for grid, start in zip(grids, before[:-1], strict=True)])
    sizes = np.concatenate([grid.sizes for grid in grids])
    face = np.concatenate([grid.face for grid in grids])
    order = np.argsort(face, kind="stable")
    rows, _ = row_positions(offsets_of(sizes), order)
    return Grid(
        np.concatenate([grid.triangle for grid in grids]),
        np.concatenate([grid.inside for grid in grids]),
        np.concatenate([grid.vertex for grid in grids]),
        corners[rows],
        sizes[order],
        face[order],
    )

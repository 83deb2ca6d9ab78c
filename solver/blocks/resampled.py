"""The surface of blocks as a mesh of any density, written a part of a block at a time.

Faces are split as `surface.subdivision` does it.  New vertices on an edge that several parts share are made by the
first of them; the others find their numbers by the ends of the edge.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Booleans, Indices, row_positions
from ..mesh.edges import edge_keys
from ..progress import Progress, Steps
from ..surface.resampling import checked_splits, vertex_samples
from ..surface.subdivision import subdivided
from .content import SolvedBlock
from .cut import Part
from .folder import JobFolder
from .large_mesh import parts_of
from .triangle_index import TriangleIndex

POINTS_AT_ONCE = 1 << 19
"""About how many points a part of a block gets."""


@dataclass(frozen=True, eq=False)
class BlocksResampled:
    """A resampled surface: P vertices, those of the input first; F faces; L corners; all mapped into memory.

    Attributes
    ----------
    vertices
        (P, 3), scene units, of the input's type.
    corners, sizes
        Vertices of the faces, one face after the other, (L,), and the number of each face's corners (F,).
    keeper
        What keeps the files.
    """

    vertices: NDArray[np.floating[Any]]
    corners: NDArray[np.integer[Any]]
    sizes: NDArray[np.int32]
    keeper: object

    @property
    def faces(self) -> NDArray[np.integer[Any]] | list[NDArray[np.integer[Any]]]:
        """The faces, (F, n) where all have n corners, else a list of polygons."""
        if len(self.sizes) and all((part == self.sizes[0]).all() for part in parts_of(self.sizes)):
            return self.corners.reshape(-1, int(self.sizes[0]))
        return np.split(self.corners, np.cumsum(self.sizes)[:-1]) if len(self.sizes) else []


class Surface(Protocol):
    """What is resampled: a `BlockSurface`."""

    @property
    def blocks(self) -> int:
        """How many there are."""

    @property
    def corners(self) -> int:
        """How many corners the faces have together."""

    @property
    def index(self) -> TriangleIndex:
        """Which blocks count in which triangles."""

    @property
    def folder(self) -> JobFolder:
        """Where the blocks are."""

    def block(self, number: int) -> tuple[SolvedBlock, Indices]:
        """Return a solved block, and the numbers of its triangles in the mesh."""

    def at_vertices(self) -> NDArray[np.floating[Any]]:
        """The surface at the input's vertices, (V, 3)."""

    def evaluate(self, face_index: Indices, barycentric: Array) -> Array:
        """The surface anywhere, (N, 3)."""


def resample_blocks_steps(surface: Surface, splits: int, beside: Path | None = None) -> Steps[BlocksResampled]:
    """`BlockSurface.resample` as a generator of `Progress`; closing it cancels."""
    given = surface.at_vertices()
    splits = checked_splits(splits, surface.corners)
    keeper = tempfile.TemporaryDirectory(prefix=".sparse_surface_", dir=beside)
    names = ("vertices", "corners", "sizes")
    with ExitStack() as stack:
        files: list[IO[bytes]] = [stack.enter_context(open(Path(keeper.name) / name, "wb")) for name in names]
        for part in parts_of(given):
            files[0].write(part.tobytes())
        seams = _Seams(len(given))
        for number in range(surface.blocks):
            yield Progress("Evaluating", number / surface.blocks, f"{number} of {surface.blocks} blocks")
            _write_block(surface, number, splits, seams, files)
    kinds = (given.dtype, np.dtype(np.int32), np.dtype(np.int32))
    arrays = [_mapped(Path(keeper.name) / name, kind) for name, kind in zip(names, kinds, strict=True)]
    return BlocksResampled(arrays[0].reshape(-1, 3), arrays[1], arrays[2], keeper)


def _mapped(path: Path, kind: np.dtype[Any]) -> NDArray[Any]:
    return np.memmap(path, kind, "r") if path.stat().st_size else np.zeros(0, kind)


@dataclass(frozen=True, eq=False)
class _Piece:
    """Some faces of a block, as `subdivided` takes them, and what their vertices and triangles are in the mesh.

    Attributes
    ----------
    vertices
        Their numbers, ascending, (n,).
    face_offsets, face_corners, triangles, polygon
        As in a representation, of these vertices.
    numbers
        The triangles' numbers in the mesh.
    shared
        Which vertices faces outside of the piece have, too, (n,).
    """

    vertices: Indices
    face_offsets: Indices
    face_corners: Indices
    triangles: Indices
    polygon: Indices
    numbers: Indices
    shared: Booleans


def _pieces(surface: Surface, number: int, splits: int) -> Iterator[_Piece]:
    """The faces for which a block is the first, some at a time."""
    (solved, numbers), part, first = surface.block(number), surface.folder.part(number), surface.index.first
    offsets = part.offsets
    own = np.flatnonzero(first[np.minimum(part.first_triangles, len(first) - 1)] == number)
    step = max(1, POINTS_AT_ONCE // splits**2)
    for start in range(0, len(own), step):
        faces = own[start : start + step]
        inside = np.full(len(part.faces), -1)
        inside[faces] = np.arange(len(faces))
        rows, face_offsets = row_positions(offsets, faces)
        vertices, corners = np.unique(part.corners[rows], return_inverse=True)
        within = np.flatnonzero(inside[solved.polygon] >= 0)
        yield _Piece(
            part.vertices[vertices],
            face_offsets,
            corners.ravel(),
            np.searchsorted(vertices, solved.triangles[within]),
            inside[solved.polygon[within]],
            numbers[within],
            _outside(part, offsets, inside < 0)[vertices],
        )


def _outside(part: Part, offsets: Indices, others: Booleans) -> Booleans:
    """Which vertices of a part some faces have, (n,)."""
    found = np.zeros(len(part.vertices), dtype=bool)
    found[part.corners[row_positions(offsets, np.flatnonzero(others))[0]]] = True
    return found


class _Seams:
    """The numbers of the new vertices, and those on edges that pieces share."""

    def __init__(self, vertices: int) -> None:
        """Begin after the vertices of the input."""
        self.count, self._vertices = vertices, vertices
        self._keys, self._firsts = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)

    def number(self, piece: _Piece, pairs: Indices, between: int, count: int) -> tuple[Indices, Indices]:
        """Number the vertices of a split piece.

        Parameters
        ----------
        piece, pairs
            The piece, and its edges as pairs of its vertices, (E, 2); the first vertices after those of the piece are
            `between` on each edge.
        between, count
            New vertices on an edge, and how many vertices there are in all.

        Returns
        -------
        numbers, new
            The number of each vertex, (count,), and which ones are new, ascending.
        """
        numbers = np.full(count, -1)
        own = len(piece.vertices)
        numbers[:own] = piece.vertices
        edges = np.flatnonzero(piece.shared[pairs].all(axis=1)) if between else np.zeros(0, dtype=np.int64)
        ends = piece.vertices[pairs[edges]]
        keys = edge_keys(ends[:, 0], ends[:, 1], self._vertices)
        place = np.searchsorted(self._keys, keys)
        known = self._keys[np.minimum(place, len(self._keys) - 1)] == keys if len(self._keys) else place < 0
        on_edge = own + edges[:, None] * between + np.arange(between)
        numbers[on_edge[known]] = self._firsts[place[known], None] + np.arange(between)
        new = np.flatnonzero(numbers < 0)
        numbers[new] = self.count + np.arange(len(new))
        self.count += len(new)
        if between:
            self._keys = np.insert(self._keys, place[~known], keys[~known])
            self._firsts = np.insert(self._firsts, place[~known], numbers[on_edge[~known, 0]])
        return numbers, new


def _write_block(surface: Surface, number: int, splits: int, seams: _Seams, files: list[IO[bytes]]) -> None:
    """Write the new vertices, and the faces, of a block."""
    kind = surface.at_vertices().dtype
    for piece in _pieces(surface, number, splits):
        grid, pairs, _, count = subdivided(piece, splits)
        numbers, new = seams.number(piece, pairs, splits - 1, count)
        sample = vertex_samples(grid, count)[new]
        points = surface.evaluate(piece.numbers[grid.triangle[sample]], grid.inside[sample])
        files[0].write(points.astype(kind).tobytes())
        files[1].write(numbers[grid.vertex[grid.corners]].astype(np.int32).tobytes())
        files[2].write(grid.sizes.astype(np.int32).tobytes())

"""What the blocks make together: vertices, errors and the report of the whole."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..mesh.edges import connected_parts
from ..progress import Progress, Steps
from .cut import Cut
from .folder import JobFolder
from .large_mesh import ROWS_AT_ONCE, LargeMesh
from .spread import Spread
from .turning import Turning


@dataclass(frozen=True, eq=False)
class Joined:
    """The surface at the mesh's vertices, and what was measured.

    Attributes
    ----------
    vertices, patch
        Points (V, 3), of the input's type, and the patch of the largest weight, counted over all blocks, -1 where the
        input passes through, (V,).
    between
        Distances between the vertices.
    reports
        The blocks' reports.
    pieces
        Connected components of the mesh.
    turning
        How far the faces' normals turn.
    creases
        Edges that the blocks mark as sharp, pairs of vertices, ascending, (E, 2).
    """

    vertices: NDArray[np.floating[Any]]
    patch: NDArray[np.int32]
    between: Spread
    reports: list[dict[str, Any]]
    pieces: int
    turning: Turning
    creases: Indices


@dataclass(eq=False)
class _Sum:
    """Sums of rows with equal numbers, in the order in which they come."""

    numbers: list[Indices] = field(default_factory=list)
    rows: list[NDArray[Any]] = field(default_factory=list)

    def add(self, numbers: Indices, rows: NDArray[Any]) -> None:
        self.numbers.append(numbers)
        self.rows.append(rows)

    def sums(self) -> tuple[Indices, Array]:
        """Return the numbers, ascending, and the sums of their rows."""
        numbers = np.concatenate(self.numbers)
        order = np.argsort(numbers, kind="stable")
        starts = np.flatnonzero(np.diff(numbers[order], prepend=-1))
        rows = np.concatenate(self.rows)[order].astype(np.float64)
        return numbers[order][starts], np.add.reduceat(rows, starts, axis=0) if len(starts) else rows


def joined(mesh: LargeMesh, cut: Cut, folder: JobFolder) -> Steps[Joined]:
    """Put the blocks together.

    Parts of the blocks are added in the order of the blocks, whatever the order in which they were solved.
    """
    points = np.array(mesh.positions)
    patch = np.full(len(points), -1, dtype=np.int32)
    at, within, links = _Sum(), _Sum(), _Sum()
    between, turning, reports, creases = Spread(), Turning(), [], [np.zeros((0, 2), dtype=np.int64)]
    patches = pieces = 0
    for number in range(len(cut)):
        solved, part = folder.block(number), folder.part(number)
        share, vertices = solved.share, part.vertices
        alone, own = share == 1.0, cut.block[vertices] == number
        points[vertices[alone]] = solved.points[alone]
        patch[vertices[own]] = np.where(solved.patch[own] < 0, -1, solved.patch[own].astype(np.int32) + patches)
        shared = np.flatnonzero((share > 0.0) & ~alone)
        moved = solved.points[shared].astype(np.float64) - mesh.positions[vertices[shared]]
        at.add(vertices[shared], share[shared, None] * moved)
        links.add(vertices[shared], solved.piece[shared].astype(np.int64) + pieces)
        within.add(part.triangle_numbers(solved.surface.polygon)[solved.blended], solved.parts)
        between += solved.between
        turning = turning.plus(solved.turning)
        # where blocks see different ones beside their borders, that of the edge's first vertex is asked
        marked = np.sort(vertices[solved.marked], axis=1)
        creases.append(marked[cut.block[marked[:, 0]] == number])
        reports.append(solved.report)
        patches += solved.surface.patches
        pieces += int(solved.piece.max(initial=-1)) + 1
        yield Progress("Joining blocks", (number + 1) / len(cut))
    numbers, moved = at.sums()
    points[numbers] = mesh.positions[numbers] + moved
    between += Spread.of(np.linalg.norm(within.sums()[1], axis=2)) if len(numbers) else Spread()
    turning = turning.plus(_turned(mesh, points, numbers))
    marked = np.unique(np.concatenate(creases), axis=0)
    return Joined(points, patch, between, reports, _linked(links, pieces), turning, marked)


def _linked(links: _Sum, pieces: int) -> int:
    """Number of components when pieces that hold the same vertex are one."""
    vertices, own = np.concatenate(links.numbers), np.concatenate(links.rows)
    order = np.argsort(vertices, kind="stable")
    same = np.flatnonzero(np.diff(vertices[order]) == 0)
    return connected_parts(own[order][same], own[order][same + 1], pieces)[0]


def _turned(mesh: LargeMesh, after: NDArray[Any], shared: Indices) -> Turning:
    """How the faces turn at vertices that blocks share; the blocks have measured all others."""
    marked = np.zeros(len(after), dtype=bool)
    marked[shared] = True
    turning = Turning()
    for first in range(0, mesh.face_count, ROWS_AT_ONCE):
        faces = np.arange(first, min(first + ROWS_AT_ONCE, mesh.face_count))
        corners, offsets = mesh.corners_of(faces)
        faces = faces[np.logical_or.reduceat(marked[corners], offsets[:-1])]
        if len(faces):
            corners, offsets = mesh.corners_of(faces)
            vertices, corners = np.unique(corners, return_inverse=True)
            old, new = (array[vertices].astype(np.float64) for array in (mesh.positions, after))
            turning = turning.plus(Turning.of(old, new, corners.ravel(), offsets))
    return turning


def distances(mesh: LargeMesh, after: NDArray[Any]) -> Array:
    """Distance of each vertex from the input, (V,)."""
    error = np.empty(len(after))
    for first in range(0, len(after), ROWS_AT_ONCE):
        part = slice(first, first + ROWS_AT_ONCE)
        error[part] = np.linalg.norm(after[part].astype(np.float64) - mesh.positions[part], axis=1)
    return error


def longest_side(mesh: LargeMesh) -> float:
    """Longest side of the box around the vertices that faces use."""
    used = np.zeros(len(mesh.positions), dtype=bool)
    for first in range(0, len(mesh.corners), ROWS_AT_ONCE):
        used[mesh.corners[first : first + ROWS_AT_ONCE]] = True
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for first in range(0, len(used), ROWS_AT_ONCE):
        part = mesh.positions[first : first + ROWS_AT_ONCE][used[first : first + ROWS_AT_ONCE]]
        if len(part):
            low, high = np.minimum(low, part.min(axis=0)), np.maximum(high, part.max(axis=0))
    return float((high - low).max())

"""What the blocks make together: vertices, errors and the report of the whole."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Booleans, Indices, any_of, length_of
from ..mesh.edges import connected_parts
from ..mesh.sampling import MEASURED_SAMPLES
from ..progress import Progress, Steps
from ..surface.spread import Spread
from .cut import Cut
from .folder import JobFolder
from .large_mesh import ROWS_AT_ONCE, LargeMesh, narrow_type, numbered_parts, parts_of
from .scratch import Scratch
from .triangle_index import IndexMaker
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
class _Links:
    """Pieces of blocks that hold the same vertex."""

    vertices: list[Indices] = field(default_factory=list)
    pieces: list[Indices] = field(default_factory=list)
    count: int = 0

    def add(self, vertices: Indices, pieces: Indices, count: int) -> None:
        """Note the pieces of a block, of which it has `count`, at some vertices."""
        self.vertices.append(vertices.astype(narrow_type(int(vertices.max(initial=0)))))
        self.pieces.append((pieces + self.count).astype(narrow_type(self.count + count)))
        self.count += count

    def components(self) -> int:
        """How many pieces there are when those that hold the same vertex are one."""
        vertices, pieces = np.concatenate(self.vertices), np.concatenate(self.pieces)
        order = np.argsort(vertices, kind="stable")
        same = np.flatnonzero(np.diff(vertices[order]) == 0)
        return connected_parts(pieces[order][same], pieces[order][same + 1], self.count)[0]


class _Inside:
    """Sums of the blocks' parts of S(x) - x in the triangles that they share, (n, 6, 3), in a file."""

    def __init__(self, triangles: int, most: int, scratch: Scratch) -> None:
        """Prepare for some of the mesh's triangles, no more than `most` of them."""
        self._scratch = scratch
        self._row = scratch.array("row", (triangles,), narrow_type(most))
        self._sums = scratch.array("sums", (most, len(MEASURED_SAMPLES), 3), np.float64)
        self._used = 0

    def add(self, triangles: Indices, parts: NDArray[np.float32]) -> None:
        """Add the parts of a block, whose triangles are different ones."""
        new = triangles[self._row[triangles] == 0]
        self._row[new] = np.arange(self._used + 1, self._used + len(new) + 1)  # 0: has no row yet
        self._used += len(new)
        self._sums[self._row[triangles] - 1] += parts

    def spread(self) -> Spread:
        """Measure the sums."""
        total = Spread()
        for part in parts_of(self._sums[: self._used]):
            total += Spread.of(length_of(part))
            self._scratch.rest()
        return total


def joined(mesh: LargeMesh, cut: Cut, folder: JobFolder, scratch: Scratch) -> Steps[Joined]:
    """Put the blocks together.

    Parts of the blocks are added in the order of the blocks, whatever the order in which they were solved.
    """
    points = scratch.array("points", mesh.positions.shape, mesh.positions.dtype)
    moved = scratch.array("moved", mesh.positions.shape, np.float64)
    patch = scratch.array("patch", (len(points),), np.int32)
    for first, part in numbered_parts(mesh.positions):
        points[first : first + len(part)] = part
        patch[first : first + len(part)] = -1
        scratch.rest()
    blended = sum(folder.blended(number) for number in range(len(cut)))
    index = IndexMaker(mesh.triangle_count, scratch.array)
    inside = _Inside(mesh.triangle_count, blended, scratch)
    links, between, turning, reports = _Links(), Spread(), Turning(), []
    shared, creases = np.zeros(len(points), dtype=bool), [np.zeros((0, 2), dtype=np.int64)]
    patches = 0
    for number in range(len(cut)):
        solved, held = folder.measured(number), folder.part(number)
        share, vertices = solved.share, held.vertices
        alone, own = share == 1.0, cut.block[vertices] == number
        points[vertices[alone]] = solved.points[alone]
        patch[vertices[own]] = np.where(solved.patch[own] < 0, -1, solved.patch[own].astype(np.int32) + patches)
        some = np.flatnonzero((share > 0.0) & ~alone)
        away = solved.points[some].astype(np.float64) - mesh.positions[vertices[some]]
        moved[vertices[some]] += share[some, None] * away
        shared[vertices[some]] = True
        links.add(vertices[some], solved.piece[some], int(solved.piece.max(initial=-1)) + 1)
        numbers = held.triangle_numbers(solved.polygon)
        inside.add(numbers[solved.blended], solved.parts)
        index.add(number, numbers[any_of(share[solved.triangles] > 0.0)])
        between += solved.between
        turning = turning.plus(solved.turning)
        # where blocks see different ones beside their borders, that of the edge's first vertex is asked
        marked = np.sort(vertices[solved.marked], axis=1)
        creases.append(marked[cut.block[marked[:, 0]] == number])
        reports.append(solved.report)
        patches += solved.patches
        scratch.rest()
        yield Progress("Joining blocks", (number + 1) / len(cut))
    for first, part in numbered_parts(shared):
        numbers = first + np.flatnonzero(part)
        points[numbers] = mesh.positions[numbers] + moved[numbers]
        scratch.rest()
    index.save(folder)
    turning = turning.plus(_turned(mesh, points, shared))
    scratch.rest()
    marked = np.unique(np.concatenate(creases), axis=0)
    return Joined(points, patch, between + inside.spread(), reports, links.components(), turning, marked)


def _turned(mesh: LargeMesh, after: NDArray[Any], shared: Booleans) -> Turning:
    """How the faces turn at vertices that blocks share; the blocks have measured all others."""
    turning = Turning()
    for first in range(0, mesh.face_count, ROWS_AT_ONCE):
        faces = np.arange(first, min(first + ROWS_AT_ONCE, mesh.face_count))
        corners, offsets = mesh.corners_of(faces)
        faces = faces[np.logical_or.reduceat(shared[corners], offsets[:-1])]
        if len(faces):
            corners, offsets = mesh.corners_of(faces)
            vertices, corners = np.unique(corners, return_inverse=True)
            old, new = (array[vertices].astype(np.float64) for array in (mesh.positions, after))
            turning = turning.plus(Turning.of(old, new, corners.ravel(), offsets))
    return turning


def distances(mesh: LargeMesh, after: NDArray[Any], error: Array) -> None:
    """Set the distance of each vertex from the input, (V,)."""
    for first, part in numbered_parts(after):
        away = part.astype(np.float64) - mesh.positions[first : first + len(part)]
        error[first : first + len(part)] = np.linalg.norm(away, axis=1)


def longest_side(mesh: LargeMesh) -> float:
    """Longest side of the box around the vertices that faces use."""
    used = np.zeros(len(mesh.positions), dtype=bool)
    for part in parts_of(mesh.corners):
        used[part] = True
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for first, part in numbered_parts(mesh.positions):
        points = part[used[first : first + len(part)]]
        if len(points):
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    return float((high - low).max())

"""One block by itself: a pure function of its task, which holds only arrays and settings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..approximation.approximate import approximate_steps
from ..approximation.result import Approximation
from ..arrays import Array, Indices, offsets_of, row_positions
from ..mesh.edges import connected_parts
from ..mesh.normals import triangle_areas
from ..mesh.sampling import MEASURED_SAMPLES
from ..mesh.triangulation import triangulate
from ..processes.threads import on_one_thread
from ..progress import FINISH, Steps, run_to_end
from ..settings import Settings
from ..surface.metrics import surface_error
from ..surface.representation import Representation
from ..surface.spread import Spread
from .content import SolvedBlock
from .shares import shares_of
from .turning import Turning

TRIANGLES_AT_ONCE = 100_000


@dataclass(frozen=True, eq=False)
class BlockTask:
    """A block with its halo: n vertices, f faces.

    Attributes
    ----------
    number
        Which block it is.
    whole
        Whether it is the only one.
    positions, blocks
        Positions (n, 3) and the block of each vertex (n,).
    corners, sizes
        The faces' corners as positions in `positions`, one face after the other, and how many each has: one number
        where all have as many.
    weights, sharp_edges
        As in `approximate`.
    settings
        Resolved settings.
    reach
        How many steps the block counts beyond its own vertices.
    hurry
        Whether it is to end as early as it can, as after `FINISH`.
    """

    number: int
    whole: bool
    positions: NDArray[np.floating[Any]]
    blocks: NDArray[np.int32]
    corners: NDArray[np.int32]
    sizes: NDArray[np.int32] | int
    weights: Array | None
    sharp_edges: Indices
    settings: Settings
    reach: int
    hurry: bool = False

    @property
    def offsets(self) -> Indices:
        """Where each face's corners begin, (f + 1,)."""
        if isinstance(self.sizes, int):
            return np.arange(0, len(self.corners) + 1, self.sizes)
        return offsets_of(self.sizes.astype(np.int64))

    @property
    def faces(self) -> NDArray[np.int32] | list[list[int]]:
        """The faces as `approximate` takes them."""
        if isinstance(self.sizes, int):
            return self.corners.reshape(-1, self.sizes)
        return [part.tolist() for part in np.split(self.corners, self.offsets[1:-1])]


def solve_block(task: BlockTask) -> bytes:
    """Solve a block and return the content of its file."""
    return run_to_end(solve_block_steps(task))


@on_one_thread
def solve_block_steps(task: BlockTask) -> Steps[bytes]:
    """`solve_block` as a generator of `Progress`; closing it cancels, sending `FINISH` ends it early."""
    offsets = task.offsets
    share = shares_of(task.number, task.blocks, task.corners, offsets, task.reach)
    settings, weights = task.settings, task.weights
    if (share < 1.0).any():
        # What the block does not count at passes through: nothing is fitted there.
        weights = np.where(share > 0.0, 1.0 if weights is None else weights, 0.0)
    points = task.positions.astype(np.float64)
    triangles = triangulate(points, task.corners.astype(np.int64), offsets)
    if not task.whole and not triangle_areas(points, triangles[0]).any():
        return _without_surface(task, share, triangles).to_bytes()
    steps = approximate_steps(
        task.positions, task.faces, settings, triangles=triangles, weights=weights, sharp_edges=task.sharp_edges
    )
    found = (yield from _hurried(steps)) if task.hurry else (yield from steps)
    return _solved(task, share, triangles[0], found).to_bytes()


def _hurried(steps: Steps[Approximation]) -> Steps[Approximation]:
    """Relay a computation that is asked to end early from its beginning."""
    try:
        step = next(steps)
        while True:
            yield step
            step = steps.send(FINISH)
    except StopIteration as end:
        found: Approximation = end.value
        return found
    finally:
        steps.close()


def _solved(task: BlockTask, share: Array, triangles: Indices, found: Approximation) -> SolvedBlock:
    """Measure a block where it counts."""
    edges = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    _, piece = connected_parts(edges[:, 0], edges[:, 1], len(share))
    counts = share[triangles]
    blended = np.flatnonzero((counts > 0.0).any(axis=1) & (counts < 1.0).any(axis=1))
    alone = np.flatnonzero((counts == 1.0).all(axis=1))
    between, turning = Spread(), Turning()
    if not task.whole:
        points = task.positions.astype(np.float64)
        turning = _turning(task, share, points, found.vertices.astype(np.float64))
        for start in range(0, len(alone), TRIANGLES_AT_ONCE):
            part = alone[start : start + TRIANGLES_AT_ONCE]
            between += Spread.of(surface_error(found.representation, part, vertices=points))
    return SolvedBlock(
        share,
        found.vertices,
        found.patch.astype(np.int64),
        piece,
        blended,
        _parts(task, found, triangles, blended, counts[blended]),
        np.zeros((0, 2), dtype=np.int64) if found.creases is None else found.creases,
        between,
        turning,
        found.report,
        triangles,
        found.representation.polygon,
        found.representation.patches,
        replace(found.representation, initial=""),
    )


def _turning(task: BlockTask, share: Array, before: Array, after: Array) -> Turning:
    """How far the normals of the faces turn at which the block counts alone."""
    alone = np.flatnonzero(np.logical_and.reduceat(share[task.corners] == 1.0, task.offsets[:-1]))
    places, offsets = row_positions(task.offsets, alone)
    return Turning.of(before, after, task.corners[places].astype(np.int64), offsets)


def _parts(
    task: BlockTask, found: Approximation, triangles: Indices, blended: Indices, counts: Array
) -> NDArray[np.float32]:
    """The block's part of S(x) - x in triangles that it shares with others, (b, 6, 3)."""
    count = len(MEASURED_SAMPLES)
    inside = np.tile(MEASURED_SAMPLES, (len(blended), 1))
    points = found.representation.evaluate(np.repeat(blended, count), inside).reshape(-1, count, 3)
    flat = np.einsum("qk,tkd->tqd", MEASURED_SAMPLES, task.positions.astype(np.float64)[triangles[blended]])
    parts = (points - flat) * (counts @ MEASURED_SAMPLES.T)[:, :, None]
    return parts.astype(np.float32)


def _without_surface(task: BlockTask, share: Array, triangles: tuple[Indices, Indices]) -> SolvedBlock:
    """A block without area, which passes through: it has no patches and no report."""
    none, rows = np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    one = np.zeros(1, dtype=np.int64)
    surface = Representation(
        task.positions.astype(np.float64), *triangles, none, none, one, none, one, none.reshape(0, 3), none,
        np.zeros((1, 0, 2)), np.zeros((1, 0, 2)), rows[:, 0], "partition", rows, rows[:, :1], "legendre", 0,
        none.reshape(0, 3, 0), np.zeros((0, 3, 0)), rows[:, :0],
    )  # fmt: skip
    passing = np.full(len(share), -1, dtype=np.int64)
    parts = np.zeros((0, len(MEASURED_SAMPLES), 3), dtype=np.float32)
    return SolvedBlock(
        share,
        task.positions,
        passing,
        np.arange(len(share)),
        none,
        parts,
        none.reshape(0, 2),
        Spread(),
        Turning(),
        {},
        *triangles,
        0,
        surface,
    )

"""Moving one surface onto another: iterated closest points, to planes, from several starts.

Each step moves A such that its places come closest to the planes through their nearest points on B (Y. Chen and
G. Medioni, "Object modelling by registration of multiple range images", 1992).  Pairs that are far apart compared with
most are left out (D. Chetverikov et al., "The trimmed iterative closest point algorithm", 2002).  The steps find the
nearest of many possible ends; so they start from every way to lay the principal axes of A on those of B.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product
from typing import Any

import numpy as np

from ..arrays import Array, Booleans
from ..errors import InputError
from ..mesh.normals import face_normals
from ..processes.threads import on_one_thread
from ..progress import Progress, Steps
from .motions import moved_by, placing, small_motion
from .shared_polygons import SHARED, TRIANGLES, Corners, move_corners
from .surfaces import Surface
from .targets import PointTarget, Target

COARSE_PLACES, FINE_PLACES, LAST_PLACES = 400, 3000, 40_000
COARSE_STEPS, FINE_STEPS, LAST_STEPS = 15, 25, 6
STAND_IN_PLACES = 20_000
"""Places on B with the normals there, whose nearest ones are found fast; only the last steps take B itself."""

KEPT_STARTS, MOST_STARTS = 4, 8
"""So many different ends are refined, and so many where those of a symmetric part are equally good."""

FAR_PAIR = 4.0
"""A pair is left out when it is this many times as far apart as the median pair."""

EQUALLY_GOOD = 1.1
"""Ends whose residual is within this factor of the best are equally good."""

SAME_END = 1e-3
"""Two ends are the same when no place differs by more than this share of the side."""

SAME_START = 0.05
"""The same for ends that are still to be refined."""

GOOD_RESIDUAL, GOOD_OVERLAP = 0.02, 0.5


@dataclass(frozen=True, eq=False)
class Alignment:
    """How A is moved onto B.

    Attributes
    ----------
    matrix
        (4, 4); moves points of A.
    residual
        Root mean square distance of the pairs that were used, in scene units.
    overlap
        Share of the places on A that have a partner on B: those that were not left out as too far.
    equally_good
        How many different ends were about as good; more than one for symmetric parts, where the choice is arbitrary.
    problem
        Why the result should not be trusted; empty where nothing speaks against it.
    """

    matrix: Array
    residual: float
    overlap: float
    equally_good: int
    problem: str

    def report(self) -> dict[str, Any]:
        """Return residual, overlap, number of equally good ends and the problem."""
        names = ("residual", "overlap", "equally_good", "problem")
        return {name: getattr(self, name) for name in names}


@on_one_thread
def align_steps(a: Surface, b: Surface, *, scaled: bool = False) -> Steps[Alignment]:
    """Move A onto B; with `scaled` its size may change.

    Raises
    ------
    InputError
        When a surface has fewer than four points, or no extent.
    """
    for surface in (a, b):
        if len(surface.vertices) < 4 or surface.longest_side == 0.0:
            raise InputError("A surface of fewer than four points cannot be aligned.")
    side = b.longest_side
    places = [_some(a, count) for count in (COARSE_PLACES, FINE_PLACES, LAST_PLACES)]
    stand_in = _stand_in(b)
    starts = _starts(_some(a, FINE_PLACES), _some(b, FINE_PLACES), scaled)
    ends = []
    for number, start in enumerate(starts):
        yield Progress("Aligning", 0.6 * number / len(starts), f"start {number + 1} of {len(starts)}")
        ends.append(_iterate(places[0], stand_in, start, scaled, COARSE_STEPS, side))
    ends = _different(ends, places[0], SAME_START * side)
    limit = min(EQUALLY_GOOD * ends[0].cost, GOOD_RESIDUAL * side)
    kept, finer = ends[:KEPT_STARTS] + [end for end in ends[KEPT_STARTS:MOST_STARTS] if end.cost <= limit], []
    for number, end in enumerate(kept):
        yield Progress("Aligning", 0.6 + 0.3 * number / len(kept), "refining the best starts")
        finer.append(_iterate(places[1], stand_in, end.matrix, scaled, FINE_STEPS, side))
    best = min(finer, key=lambda end: end.cost)
    good = _different([end for end in finer if end.cost <= EQUALLY_GOOD * best.cost], places[1], SAME_END * side)
    yield Progress("Aligning", 0.9, "with all places")
    last = _iterate(places[2], b.target, best.matrix, scaled, LAST_STEPS, side)
    if a.is_mesh and b.is_mesh:
        yield Progress("Aligning", 0.95, "with shared polygons")
        last = _by_polygons(a, b, last, [end.matrix for end in good[1:]], scaled)
    return Alignment(last.matrix, last.residual, last.overlap, len(good), _problem(last, side))


@dataclass(frozen=True, eq=False)
class _End:
    matrix: Array
    residual: float
    overlap: float
    cost: float
    settled: bool


def _some(surface: Surface, count: int) -> Array:
    places = surface.samples(count)
    return places[:: max(1, len(places) // count)]


def _stand_in(b: Surface) -> Target:
    if not b.is_mesh:
        return b.target
    places, triangle = b.samples_and_triangles(STAND_IN_PLACES)
    return PointTarget(places, face_normals(b.vertices, b.triangles)[triangle])


def _starts(a: Array, b: Array, scaled: bool) -> list[Array]:
    """Return the 24 rotations that lay the principal axes of A on those of B, middle on middle."""
    (middle_a, axes_a, size_a), (middle_b, axes_b, size_b) = _principal(a), _principal(b)
    scale = size_b / size_a if scaled else 1.0
    found = []
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        turn = np.zeros((3, 3))
        turn[np.arange(3), order] = signs
        if np.linalg.det(turn) > 0.0:
            found.append((order != (0, 1, 2), placing(scale * axes_b @ turn @ axes_a.T, middle_a, middle_b)))
    return [matrix for _, matrix in sorted(found, key=lambda each: each[0])]


def _principal(points: Array) -> tuple[Array, Array, float]:
    """Return middle, right-handed principal axes as columns, and root mean square distance from the middle."""
    middle = points.mean(axis=0)
    spread = (points - middle).T @ (points - middle) / len(points)
    axes = np.linalg.eigh(spread)[1]
    axes[:, 2] *= np.sign(np.linalg.det(axes)) or 1.0
    return middle, axes, float(np.sqrt(np.trace(spread)))


def _iterate(places: Array, target: Target, start: Array, scaled: bool, steps: int, side: float) -> _End:
    """Repeat: pair places with B, leave far pairs out, step; until steps are as small as rounding."""
    matrix, settled = start, False
    for step in range(steps + 1):
        moved = moved_by(matrix, places)
        found = target.nearest(moved)
        kept = _kept(found.distance, side)
        if settled or step == steps:
            break
        change = small_motion(moved[kept], found.foot[kept], target.normals(found)[kept], scaled)
        matrix = change @ matrix
        far = np.abs(moved @ (change[:3, :3] - np.eye(3)).T + change[:3, 3]).max()
        settled = bool(far < 1e-12 * side)
    size = float(np.linalg.norm(matrix[:3, 0]))
    residual = float(np.sqrt((found.distance[kept] ** 2).mean()))
    # Shrinking A to a point would make every distance zero; leaving out all but a few pairs nearly so.
    cost = float(np.minimum(found.distance, 0.1 * side).mean()) / min(size, 1.0)
    return _End(matrix, residual, float(kept.mean()), cost, settled)


def _kept(distance: Array, side: float) -> Booleans:
    return np.asarray(distance <= FAR_PAIR * np.median(distance) + 1e-9 * side)


def _by_polygons(a: Surface, b: Surface, last: _End, others: list[Array], scaled: bool) -> _End:
    """Return where A's vertices lie on those of B, where the meshes have the same polygons; `last` where not.

    Of ends that are equally good the polygons tell the right one.
    """
    corners = Corners(b)
    triangles = a.triangles[:: 1 + len(a.triangles) // TRIANGLES]
    found = [(corners.pairs(moved_by(start, a.vertices), triangles), start) for start in (last.matrix, *others)]
    shared = [(pairs.apart, start) for pairs, start in found if pairs.share >= SHARED]
    if not shared:
        return last
    start = min(shared, key=lambda each: each[0])[1]
    matrix, side = move_corners(a.vertices, triangles, corners, start, scaled), b.longest_side
    end = _iterate(_some(a, LAST_PLACES), b.target, matrix, scaled, 0, side)
    return end if end.cost <= EQUALLY_GOOD * last.cost + 1e-12 * side else last


def _different(ends: list[_End], places: Array, apart: float) -> list[_End]:
    """Return the ends by their cost, without those that put no place farther than `apart` from an earlier one's."""
    different: list[tuple[_End, Array]] = []
    for end in sorted(ends, key=lambda each: each.cost):
        moved = moved_by(end.matrix, places)
        if all(np.abs(moved - other).max() > apart for _, other in different):
            different.append((end, moved))
    return [end for end, _ in different]


def _problem(end: _End, side: float) -> str:
    if end.residual > GOOD_RESIDUAL * side:
        return "The surfaces stay far apart: they may not show the same part."
    if end.overlap < GOOD_OVERLAP:
        return "Most of the first surface has no partner on the second."
    return ""

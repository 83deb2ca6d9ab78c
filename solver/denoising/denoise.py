"""Denoising a mesh: the steps in order, as one computation that reports its progress."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, Booleans, Indices
from ..errors import InputError, SettingsError
from ..mesh.input_checks import as_positions, checked_edges
from ..mesh.normals import normals_and_areas, unit
from ..mesh.objects import Given
from ..mesh.potential_creases import cut_along_marked
from ..mesh.triangle_mesh import TriangleMesh, build_mesh
from ..processes.threads import on_one_thread
from ..progress import FINISH, Progress, Steps, relayed, within
from .creases import FindCreases, cut_between, no_creases
from .found_noise import find_noise
from .missed_shape import bring_back
from .noise_level import STRONG, mean_edge_length
from .normal_filter import filter_normals, guide_deviation, smooth_normals
from .one_sided_patches import PatchFitter, PatchRule
from .patch_average import PatchAverage
from .preview import Preview
from .seeds import scattered
from .surface import Surface, build_surface
from .triangle_repair import repair_triangles
from .vertex_update import (
    LARGEST_MOVE,
    LEAST_VARIANCE,
    fill_in,
    keep_shape,
    move_wild_ones_far,
    settle,
    update_directions,
)

LARGEST_STRENGTH = 10.0

_FINE = PatchRule((14, 28, 56, 112, 224, 448), normal_width=0.16, largest_change=4.0, caution=0.85, misfit_power=1.0)
_COARSE = PatchRule((250,), normal_width=0.3, largest_change=4.0, caution=0.85, misfit_power=4.0)
_LARGE = replace(_FINE, sizes=(60, 120, 250, 500), wide=0.75)

_BESIDE = 2
"""Rings of triangles around wide smooth sides whose patches are fitted twice."""

_ON_WIDE_SIDES = 6.0
"""Their `largest_change`."""

_AT_CREASES = 0.25
"""How much the first patches weigh where creases were found that they did not know."""

_COVERAGE = 6  # patches over each triangle that are enough ...
_CROWD = 18  # ... and on wide sides over a seed, however few lie elsewhere, unless errors are alike
_BATCHES = 8
_STEPS_DOWN = 3


@dataclass(frozen=True)
class Denoised:
    """A denoised mesh.

    Attributes
    ----------
    vertices
        Positions, (V, 3), of the input's floating-point type; a copy of the input where the mesh is clean.
    noise_level
        Standard deviation of the removed noise along the surface's normals, in scene units; 0 where nothing moved.
    estimated_noise_level
        The noise level estimated from the mesh, in scene units, even if another one was given.
    relative_noise
        `noise_level` over the mean edge length.
    displacement
        How far each vertex moved, (V,), in scene units.
    given
        The mesh as `denoise` was given it.
    """

    vertices: NDArray[np.floating[Any]]
    noise_level: float
    estimated_noise_level: float
    relative_noise: float
    displacement: Array
    given: Given | None = None

    def as_(self, kind: str | None = None) -> Any:
        """Return the mesh that was given, with the denoised vertices; see `Approximation.as_`."""
        if self.given is None:
            raise InputError("This result does not know its mesh: it was made step by step.")
        return self.given.back(self.vertices, kind)


@on_one_thread
def denoise_with(
    find_creases: FindCreases,
    vertices: ArrayLike,
    faces: ArrayLike | list[list[int]],
    *,
    noise_level: float | None = None,
    strength: float = 1.0,
    triangles: tuple[Indices, Indices] | None = None,
    sharp_edges: ArrayLike | None = None,
) -> Steps[Denoised]:
    """Denoise a mesh as `approximation.denoised` does, with what finds creases after a first pass."""
    _check(noise_level, strength)
    given = as_positions(vertices)
    mesh = build_mesh(given, faces, triangles)
    marked = checked_edges(sharp_edges, len(mesh.vertices))
    surface = build_surface(mesh, cut_along_marked(mesh, marked) if len(marked) else None)
    return (yield from _denoised(given, mesh, surface, noise_level, strength, find_creases))


def _denoised(
    given: NDArray[Any],
    mesh: TriangleMesh,
    surface: Surface,
    noise_level: float | None,
    strength: float,
    find_creases: FindCreases,
) -> Steps[Denoised]:
    yield Progress("Estimating the noise", 0.0)
    edge = mean_edge_length(mesh)
    found = find_noise(mesh, surface)
    asked = strength * (found.level if noise_level is None else noise_level)
    if asked == 0 or edge == 0 or (noise_level is None and (found.is_clean or asked < found.least)):
        unmoved = given.copy() if np.issubdtype(given.dtype, np.floating) else mesh.vertices.copy()
        return Denoised(unmoved, 0.0, found.level, 0.0, np.zeros(len(given)))
    known = max(asked, found.level)
    noise = _Noise(asked, known, edge, found.sideways, inflation=found.inflation, length=found.length)
    moved, level = yield from within(_without_noise(mesh, surface, noise, find_creases), 0.05, 1.0)
    result = moved.astype(given.dtype if np.issubdtype(given.dtype, np.floating) else np.float64)
    displacement = np.linalg.norm(result.astype(np.float64) - mesh.vertices, axis=1)
    return Denoised(result, level, found.level, level / edge, displacement)


def _check(noise_level: float | None, strength: float) -> None:
    if noise_level is not None and not _lies_within(noise_level, 0.0, float(np.finfo(np.float64).max)):
        raise SettingsError(f"The noise level must be a length of 0 or more, not {noise_level!r}.")
    if not _lies_within(strength, 0.0, LARGEST_STRENGTH):
        raise SettingsError(f"The strength must be a number from 0 to {LARGEST_STRENGTH:g}, not {strength!r}.")


def _lies_within(value: Any, low: float, high: float) -> bool:
    return not isinstance(value, bool) and isinstance(value, Real) and low <= float(value) <= high


@dataclass(frozen=True)
class _Noise:
    """What is known of the noise, lengths in the unit of the vertices.

    Attributes
    ----------
    level
        Standard deviation along the normals that is to be removed.
    known
        The largest plausible one.
    edge
        Mean edge length.
    sideways
        Whether vertices may be off within the surface, too.
    inflation
        How many times as much of the noise averages over patches show as of independent noise of that level.
    length
        Correlation length in edges; 0 for independent noise.
    """

    level: float
    known: float
    edge: float
    sideways: bool
    inflation: float = 1.0
    length: float = 0.0

    @property
    def effective(self) -> float:
        """The level of independent noise that averages over patches show as much of."""
        return self.level * self.inflation

    def scaled(self, factor: float) -> _Noise:
        """Return the same noise in another unit."""
        return replace(self, level=self.level * factor, known=self.known * factor, edge=self.edge * factor)


def _without_noise(
    mesh: TriangleMesh, surface: Surface, noise: _Noise, find_creases: FindCreases = no_creases
) -> Steps[tuple[Array, float]]:
    """Return the moved vertices, and the noise level that was finally used."""
    used = mesh.vertices[mesh.triangles]
    centre, scale = used.mean(axis=(0, 1)), mesh.longest_side
    noisy = (mesh.vertices - centre) / scale
    asked, noise = noise.level, noise.scaled(1 / scale)
    fraction = 0.0
    for step in range(_STEPS_DOWN + 1):
        end = fraction + 0.8 * (1.0 - fraction)
        fitting = relayed(_pass(surface, noisy, noise, find_creases), lambda shown: _placed(shown, scale, centre))
        moved, directions = yield from within(fitting, fraction, end)
        along = np.abs(((moved - noisy) * directions).sum(axis=1))[mesh.used[: len(noisy)]]
        # Removing noise moves half of the vertices by less than 0.67 of its level; larger moves flatten the shape.
        if step == _STEPS_DOWN or np.median(along) <= noise.known:
            break
        noise, fraction = replace(noise, level=noise.level / 2), end
    held = (moved == noisy).all(axis=1)
    return np.where(held[:, None], mesh.vertices, moved * scale + centre), asked * 0.5**step


def _placed(step: Progress, scale: float, centre: Array) -> Progress:
    """Return a step with its surface in scene units."""
    surface = step.surface
    return step if surface is None else replace(step, surface=lambda: surface() * scale + centre)


def _pass(surface: Surface, noisy: Array, noise: _Noise, find_creases: FindCreases) -> Steps[tuple[Array, Array]]:
    """Return vertices without the noise, and their normals."""
    yield Progress("Filtering normals", 0.0)
    if noise.effective < STRONG * noise.edge:
        normals = filter_normals(surface, noisy, noise.effective)
        rules = [_FINE.following(guide_deviation(surface, normals, noise.effective / noise.edge))]
    else:
        spread = 1 + noise.length
        normals = smooth_normals(surface, noisy, round(2 * spread))
        rules = [_COARSE.larger(spread), _LARGE.larger(spread)]
    for number, rule in enumerate(rules):
        guide, fitting = normals, _average_of_patches(surface, noisy, normals, noise, rule)
        average = yield from within(fitting, 0.05 + 0.6 * number / len(rules), 0.05 + 0.6 * (number + 1) / len(rules))
        normals = average.normals(guide)
    again = _again_on_wide_sides(surface, noisy, (guide, normals), average, noise, rules[-1], find_creases)
    yield from within(again, 0.65, 0.95)
    normals = average.normals(normals)
    preview = Preview(surface, noisy, normals, noise.level, noise.known)
    yield Progress("Moving vertices", 0.95, surface=partial(preview.vertices, average))
    _, areas = normals_and_areas(noisy, surface.triangles)
    directions = update_directions(normals, areas, surface, len(noisy))
    moved = _moved(surface, noisy, normals, average, directions, noise)
    return moved, directions


def _again_on_wide_sides(
    surface: Surface,
    noisy: Array,
    guides: tuple[Array, Array],
    average: PatchAverage,
    noise: _Noise,
    rule: PatchRule,
    find_creases: FindCreases,
) -> Steps[None]:
    """Add patches that are guided by the first ones' normals, too, and reach across no crease between wide sides."""
    wide = _beside_wide_patches(surface, average, rule)
    if not wide.any() or average.hurried:
        return
    guide, normals = guides
    preview = Preview(surface, noisy, normals, noise.level, noise.known)
    sides = yield from within(cut_between(surface, wide, find_creases, partial(preview.vertices, average)), 0.0, 0.2)
    if sides.found:
        guide = filter_normals(sides.surface, noisy, noise.effective)
    average.hurried |= sides.hurry
    if average.hurried:
        return
    rule = replace(rule, largest_change=_ON_WIDE_SIDES)
    fitting = _average_of_patches(sides.surface, noisy, unit(guide + normals), noise, rule, (wide, average))
    second = yield from within(fitting, 0.2, 1.0)
    average.fade(sides.triangles, sides.vertices, _AT_CREASES)
    average.include(second)


def _beside_wide_patches(surface: Surface, average: PatchAverage, rule: PatchRule) -> Booleans:
    """Triangles on wide smooth sides and at their creases, (T,).

    There the patches' own normals tell the sides apart better than filtered ones do.  In fine relief they do not: they
    would be guided by their own mistakes.
    """
    wide = average.patch_sizes >= rule.wide * rule.sizes[-1]
    around = surface.around.astype(np.float64)
    for _ in range(_BESIDE):
        wide = wide | (around @ wide.astype(np.float64) > 0.0)
    return wide


def _moved(
    surface: Surface,
    noisy: Array,
    normals: Array,
    average: PatchAverage,
    directions: Array,
    noise: _Noise,
) -> Array:
    """Return the vertices on their planes; wild ones may move far, and triangles folded over are turned back."""
    planes = average.planes()
    matrices, _, weight = planes
    moved, limit = move_wild_ones_far(noisy, planes, directions, noise.level, noise.known)
    moved = fill_in(noisy, moved, weight > 0, surface, normals, limit)
    stiffness = average.stiffness(moved - noisy, directions, LEAST_VARIANCE * limit**2)
    independent, gaussian = noise.inflation == 1.0, limit == LARGEST_MOVE * noise.level
    if independent and gaussian:  # else neighbours have errors in common, too, or those of wild ones
        moved = bring_back(noisy, moved, directions, surface, average, noise.known, limit)
    leaning = keep_shape(moved, surface, (normals, average.normal_variances()))
    moved = settle(noisy, moved, directions, stiffness, surface, leaning, limit)
    if noise.sideways:
        moved = repair_triangles(noisy, moved, matrices, weight > 0, surface, normals, limit)
    return moved


def _average_of_patches(
    surface: Surface,
    noisy: Array,
    normals: Array,
    noise: _Noise,
    rule: PatchRule,
    beside: tuple[Booleans, PatchAverage] | None = None,
) -> Steps[PatchAverage]:
    """Fit patches until enough of them cover each triangle: few on flat sides, many where patches stay small.

    With `beside` they grow from some triangles only, (T,), and are shown together with patches that were fitted before.
    """
    fitter = PatchFitter(surface, noisy, normals, noise.effective, rule)
    preview = Preview(surface, noisy, normals, noise.level, noise.known)
    average = PatchAverage(len(surface.triangles), len(noisy), rule.misfit_power)
    asked, shown = (True, [average]) if beside is None else (beside[0], [beside[1], average])
    order = scattered(np.flatnonzero(normals.any(axis=1) & asked))
    crowd = _CROWD if noise.length == 0.0 else len(order)
    for batch in range(_BATCHES):
        seeds = order[batch::_BATCHES]
        seeds = seeds[average.coverage[seeds] < (1 if average.hurried else _COVERAGE)]
        for share, some in average.uncrowded(seeds, crowd, fitter.chunk):
            done = (batch + share) / _BATCHES
            step = Progress("Fitting one-sided patches", done, surface=partial(preview.vertices, *shown))
            average.hurried |= (yield step) == FINISH
            for fits in fitter.fits(some):
                average.add(fits)
    return average

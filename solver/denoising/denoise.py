"""Denoising a mesh: the steps in order, as one computation that reports its progress."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, Indices
from ..errors import SettingsError
from ..mesh.normals import normals_and_areas
from ..mesh.triangle_mesh import TriangleMesh, build_mesh
from ..processes.threads import on_one_thread
from ..progress import FINISH, Progress, Steps, run_to_end, within
from .noise_level import STRONG, estimate_noise_level, mean_edge_length
from .normal_filter import filter_normals, smooth_normals
from .one_sided_patches import PatchFitter, PatchRule
from .patch_average import PatchAverage
from .surface import Surface, build_surface
from .vertex_update import LARGEST_MOVE, fill_in, move_to_planes, update_directions

CLEAN = 0.03
"""Relief below this share of the mean edge length counts as the mesh's own and stays ..."""

EVEN = 0.25
"""... unless it is more even than this (see `NoiseEstimate`), as only noise is, and above a third of that share."""

LARGEST_STRENGTH = 10.0

_FINE = PatchRule((14, 28, 56, 112, 224, 448), normal_width=0.16, largest_change=4.0, caution=0.85, misfit_power=1.0)
_COARSE = PatchRule((250,), normal_width=0.3, largest_change=4.0, caution=0.85, misfit_power=4.0)
_LARGE = PatchRule((60, 120, 250, 500), normal_width=0.16, largest_change=4.0, caution=0.85, misfit_power=1.0)

_COVERAGE = 6  # patches over each triangle that are enough
_BATCHES = 8
_GOLDEN = 0.6180339887498949
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
    """

    vertices: NDArray[np.floating[Any]]
    noise_level: float
    estimated_noise_level: float
    relative_noise: float
    displacement: Array


def denoise(
    vertices: ArrayLike,
    faces: ArrayLike | list[list[int]],
    *,
    noise_level: float | None = None,
    strength: float = 1.0,
    triangles: tuple[Indices, Indices] | None = None,
    report: Callable[[Progress], str | None] | None = None,
) -> Denoised:
    """Remove the noise of a mesh but preserve its creases.

    Quadratics h_k are fitted robustly to small patches that no crease crosses.  Each vertex x then moves by the d that
    minimises the weighted mean of (n_k . d - h_k(x))^2 over the tangent planes n_k of its patches, plus a small
    multiple of the squared part of d across its normal: to the surface, onto a crease or into a corner.  The patches
    are guided by filtered normals after Zheng, Fu, Au and Tai, "Bilateral normal filtering for mesh denoising" (2011).

    Parameters
    ----------
    vertices
        (V, 3) positions in scene units.
    faces
        (F, n) vertex numbers, or a list of polygons.
    noise_level
        Standard deviation of the noise along the surface's normals, in scene units; None estimates it, and leaves a
        clean mesh as it is.
    strength
        Multiplies the noise level, from 0 (nothing moves) to 10.
    triangles
        A known triangulation of the faces: corners (T, 3) and face numbers (T,).
    report
        Called with each `Progress`.

    Returns
    -------
    Denoised
        `vertices` (V, 3), `displacement` (V,), and the noise levels.

    Raises
    ------
    InputError
        When the mesh is not usable (see `build_mesh`).
    SettingsError
        When the noise level or the strength is out of range.

    Examples
    --------
    >>> from sparse_surface.solver import denoise
    >>> denoised = denoise(vertices, faces, noise_level=1e-3)
    >>> bool(denoised.displacement.max() <= 3.5 * denoised.noise_level * (1 + 1e-9))
    True
    """
    steps = denoise_steps(vertices, faces, noise_level=noise_level, strength=strength, triangles=triangles)
    return run_to_end(steps, report)


def denoise_steps(
    vertices: ArrayLike,
    faces: ArrayLike | list[list[int]],
    *,
    noise_level: float | None = None,
    strength: float = 1.0,
    triangles: tuple[Indices, Indices] | None = None,
) -> Steps[Denoised]:
    """`denoise` as a generator of `Progress`; closing it cancels, and after `FINISH` it fits fewer patches."""
    _check(noise_level, strength)
    given = np.asarray(vertices)
    return (yield from on_one_thread(_denoised(given, build_mesh(given, faces, triangles), noise_level, strength)))


def _denoised(given: NDArray[Any], mesh: TriangleMesh, noise_level: float | None, strength: float) -> Steps[Denoised]:
    yield Progress("Estimating the noise", 0.0)
    surface = build_surface(mesh)
    estimate = estimate_noise_level(mesh, surface)
    edge = mean_edge_length(mesh)
    asked = strength * (estimate.level if noise_level is None else noise_level)
    least = 0.0 if noise_level is not None else CLEAN if estimate.unevenness > EVEN else CLEAN / 3
    if asked == 0 or edge == 0 or asked < least * edge:
        unmoved = given.copy() if np.issubdtype(given.dtype, np.floating) else mesh.vertices.copy()
        return Denoised(unmoved, 0.0, estimate.level, 0.0, np.zeros(len(given)))
    moved, level = yield from within(_without_noise(mesh, surface, asked, max(asked, estimate.level)), 0.05, 1.0)
    result = moved.astype(given.dtype if np.issubdtype(given.dtype, np.floating) else np.float64)
    displacement = np.linalg.norm(result.astype(np.float64) - mesh.vertices, axis=1)
    return Denoised(result, level, estimate.level, level / edge, displacement)


def _check(noise_level: float | None, strength: float) -> None:
    if noise_level is not None and not _lies_within(noise_level, 0.0, float(np.finfo(np.float64).max)):
        raise SettingsError(f"The noise level must be a length of 0 or more, not {noise_level!r}.")
    if not _lies_within(strength, 0.0, LARGEST_STRENGTH):
        raise SettingsError(f"The strength must be a number from 0 to {LARGEST_STRENGTH:g}, not {strength!r}.")


def _lies_within(value: Any, low: float, high: float) -> bool:
    return not isinstance(value, bool) and isinstance(value, Real) and low <= float(value) <= high


def _without_noise(mesh: TriangleMesh, surface: Surface, asked: float, known: float) -> Steps[tuple[Array, float]]:
    """Return the moved vertices, and the noise level that was finally used.

    Starts from the level that is `asked` for; `known` is the largest plausible noise.
    """
    used = mesh.vertices[mesh.triangles]
    centre, scale = used.mean(axis=(0, 1)), mesh.longest_side
    noisy = (mesh.vertices - centre) / scale
    noise_level = asked / scale
    relative = asked / mean_edge_length(mesh)
    fraction = 0.0
    for step in range(_STEPS_DOWN + 1):
        end = fraction + 0.8 * (1.0 - fraction)
        moved, directions = yield from within(_pass(surface, noisy, noise_level, relative), fraction, end)
        along = np.abs(((moved - noisy) * directions).sum(axis=1))[mesh.used[: len(noisy)]]
        # Removing noise moves half of the vertices by less than 0.67 of its level; larger moves flatten the shape.
        if step == _STEPS_DOWN or np.median(along) <= known / scale:
            break
        noise_level, relative, fraction = noise_level / 2, relative / 2, end
    held = (moved == noisy).all(axis=1)
    return np.where(held[:, None], mesh.vertices, moved * scale + centre), asked * 0.5**step


def _pass(surface: Surface, noisy: Array, noise_level: float, relative: float) -> Steps[tuple[Array, Array]]:
    """Return vertices without noise of the given level, and their normals."""
    yield Progress("Filtering normals", 0.0)
    if relative < STRONG:
        normals, rules = filter_normals(surface, noisy, noise_level), [_FINE]
    else:
        normals, rules = smooth_normals(surface, noisy), [_COARSE, _LARGE]
    for number, rule in enumerate(rules):
        fitting = _average_of_patches(surface, noisy, normals, noise_level, rule)
        average = yield from within(fitting, 0.05 + 0.9 * number / len(rules), 0.05 + 0.9 * (number + 1) / len(rules))
        normals = average.normals(normals)
    yield Progress("Moving vertices", 0.95)
    _, areas = normals_and_areas(noisy, surface.triangles)
    directions = update_directions(normals, areas, surface, len(noisy))
    planes = average.planes()
    moved = move_to_planes(noisy, planes, directions, noise_level)
    moved = fill_in(noisy, moved, planes[2] > 0, surface, normals, LARGEST_MOVE * noise_level)
    return moved, directions


def _average_of_patches(
    surface: Surface, noisy: Array, normals: Array, noise_level: float, rule: PatchRule
) -> Steps[PatchAverage]:
    """Fit patches until enough of them cover each triangle: few on flat sides, many where patches stay small."""
    fitter = PatchFitter(surface, noisy, normals, noise_level, rule)
    average = PatchAverage(len(surface.triangles), len(noisy), rule.misfit_power)
    order = _scattered(np.flatnonzero(normals.any(axis=1)))
    request = None
    for batch in range(_BATCHES):
        seeds = order[batch::_BATCHES]
        seeds = seeds[average.coverage[seeds] < (_COVERAGE if request != FINISH else 1)]
        for start in range(0, len(seeds), fitter.chunk):
            done = (batch + start / len(seeds)) / _BATCHES
            answer = yield Progress("Fitting one-sided patches", done)
            request = answer or request
            for fits in fitter.fits(seeds[start : start + fitter.chunk]):
                average.add(fits)
    return average


def _scattered(numbers: Indices) -> Indices:
    """Return the numbers in an order of which every prefix is spread evenly over them."""
    return numbers[np.argsort(np.arange(len(numbers)) * _GOLDEN % 1.0, kind="stable")]

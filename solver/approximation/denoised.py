"""Denoising as a part of `approximate`: noise is taken off first, and the result is fitted only on request.

On a mesh without its noise there is little left to be gained by a sparse fit: what a few functions cannot follow
counts for more than what noise remains.  So the denoised mesh is the result, as a representation without patches,
unless a fit is asked for.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..denoising.denoise import Denoised, denoise_steps
from ..patches.observations import checked_weights
from ..progress import FINISH, Progress, Steps, within
from ..settings import Settings
from ..surface.metrics import normal_error, statistics, surface_error

if TYPE_CHECKING:
    from .result import Approximation

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

Fit = Callable[[NDArray[Any], "Array | None"], "Steps[Approximation]"]
"""What approximates positions (V, 3) with observation weights (V,)."""


def denoise_first(
    source: NDArray[Any],
    faces: Any,
    settings: Settings,
    triangles: tuple[Indices, Indices] | None,
    weights: Array | None,
    fit: Fit,
) -> Steps[Approximation]:
    """Take the noise off, fit what is left where `settings.denoise` asks for it, and measure against the input.

    Sent `FINISH` while noise is taken off, it does not fit.

    Parameters
    ----------
    source, faces, settings, triangles, weights
        As of `approximate_steps`.  Vertices of weight 0 stay where they are.
    fit
        Does the work of `approximate_steps` without denoising.
    """
    start = time.perf_counter()
    weights = checked_weights(weights, len(source))
    held = None if weights is None else weights == 0.0
    end = 0.9 if settings.denoise == "only" else 0.4
    steps = denoise_steps(
        source,
        faces,
        noise_level=settings.noise_level or None,
        strength=settings.denoise_strength,
        triangles=triangles,
    )
    denoised, hurried = yield from _heard(within(steps, 0.0, end))
    seconds = time.perf_counter() - start
    positions = denoised.vertices if held is None else np.where(held[:, None], source, denoised.vertices)
    if settings.denoise == "only" or hurried:
        weights = np.zeros(len(positions))
    result = yield from within(fit(positions, weights), end, 1.0)
    return _against_input(result, np.asarray(source, dtype=np.float64), denoised, seconds)


def _heard(steps: Steps[Denoised]) -> Steps[tuple[Denoised, bool]]:
    """Pass steps on, and note whether the work was asked to finish."""
    request: str | None = None
    finish = False
    try:
        while True:
            try:
                step: Progress = steps.send(request)
            except StopIteration as end:
                return end.value, finish
            request = yield step
            finish = finish or request == FINISH
    finally:
        steps.close()


def _against_input(result: Approximation, source: Array, denoised: Denoised, seconds: float) -> Approximation:
    """Replace what was measured against the denoised mesh by what is measured against the input."""
    surface, points = result.representation, result.vertices.astype(np.float64)
    error = np.linalg.norm(points - source, axis=1)
    at_vertices, inside = statistics(error), statistics(surface_error(surface, vertices=source).ravel())
    size = float(np.ptp(source[np.unique(surface.triangles)], axis=0).max())
    fit = {name: result.report[name] for name in ("vertex_error", "surface_error", "normal_error_degrees")}
    report = {
        **result.report,
        "input": {**result.report["input"], "bounding_box_longest_side": size},
        "vertex_error": at_vertices,
        "surface_error": inside,
        "relative": {
            "vertex_rms": at_vertices["rms"] / size,
            "vertex_max": at_vertices["max"] / size,
            "surface_rms": inside["rms"] / size,
            "surface_max": inside["max"] / size,
        },
        "normal_error_degrees": normal_error(source, points, surface.triangles),
        "denoise": {
            "noise_level": denoised.noise_level,
            "estimated_noise_level": denoised.estimated_noise_level,
            "relative_noise": denoised.relative_noise,
            "displacement": statistics(denoised.displacement),
            "fit": fit,
        },
        "seconds": {
            **result.report["seconds"],
            "denoise": seconds,
            "total": result.report["seconds"]["total"] + seconds,
        },
    }
    if not surface.patches:
        report["passed_through_vertices"] = int((error == 0.0).sum())
    return replace(result, error=error, report=report)

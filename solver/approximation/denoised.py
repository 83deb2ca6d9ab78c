"""Denoising as a part of `approximate`: noise is removed first, and the result is fitted only on request.

Once a mesh has lost its noise, a sparse fit gains little: what a few functions cannot follow outweighs the noise that
remains.  So the denoised mesh is the result, as a representation without patches, unless a fit is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, Indices
from ..denoising.denoise import Denoised, denoise_steps
from ..patches.observations import checked_weights
from ..progress import FINISH, Progress, Steps, relayed
from ..settings import Settings
from ..surface.metrics import statistics
from .measuring import Deviation


@dataclass(frozen=True)
class MeshInput:
    """A mesh to approximate.

    Attributes
    ----------
    positions
        Vertices, (V, 3), scene units; without their noise where that was removed.
    faces, triangles, weights
        As `approximate` takes them.
    denoised
        What was done to the noise; None where nothing was.
    source
        The vertices as they were given, (V, 3), where noise was removed.
    sharp_edges
        As `approximate` takes them.
    """

    positions: NDArray[Any]
    faces: ArrayLike | Sequence[Sequence[int]]
    triangles: tuple[Indices, Indices] | None = None
    weights: Array | None = None
    denoised: Denoised | None = None
    source: Array | None = None
    sharp_edges: ArrayLike | None = None

    def denoising(self, fitted: Deviation) -> dict[str, Any] | None:
        """Return `Report.denoise`, with how far the surface is from the mesh without noise that it was fitted to."""
        if self.denoised is None:
            return None
        fit = fitted.measures()
        del fit["relative"]
        return {
            "noise_level": self.denoised.noise_level,
            "estimated_noise_level": self.denoised.estimated_noise_level,
            "relative_noise": self.denoised.relative_noise,
            "displacement": statistics(self.denoised.displacement),
            "fit": fit,
        }


def remove_noise(given: MeshInput, settings: Settings) -> Steps[MeshInput]:
    """Remove the noise; a vertex of weight w < 1 goes only the share w of its way.

    Nothing of the result is to be fitted, its weights are zero, where `settings.denoise` is "only", and where `FINISH`
    was sent.
    """
    weights = checked_weights(given.weights, len(given.positions))
    steps = denoise_steps(
        given.positions,
        given.faces,
        noise_level=settings.noise_level or None,
        strength=settings.denoise_strength,
        triangles=given.triangles,
        sharp_edges=given.sharp_edges if settings.creases == "marked" else None,
    )
    share = None if weights is None else np.minimum(weights, 1.0)
    denoised, hurry = yield from _heard(relayed(steps, lambda step: _shown_held_back(step, given.positions, share)))
    if share is not None:
        denoised = _held_back(denoised, given.positions, share)
    positions = denoised.vertices
    if settings.denoise == "only" or hurry:
        weights = np.zeros(len(positions))
    source = np.asarray(given.positions, dtype=np.float64)
    return replace(given, positions=positions, weights=weights, denoised=denoised, source=source)


def _held_back(denoised: Denoised, given: NDArray[Any], share: Array) -> Denoised:
    """Return the mesh with each vertex at that share, (V,), of its way; both ends to the last bit."""
    between = (given + share[:, None] * (denoised.vertices - given)).astype(denoised.vertices.dtype)
    between = np.where((share == 1.0)[:, None], denoised.vertices, np.where((share == 0.0)[:, None], given, between))
    return replace(
        denoised, vertices=between.astype(denoised.vertices.dtype), displacement=share * denoised.displacement
    )


def _shown_held_back(step: Progress, given: NDArray[Any], share: Array | None) -> Progress:
    """Return a step whose surface goes that share, (V,), of its way."""
    surface = step.surface
    if surface is None or share is None:
        return step
    return replace(step, surface=lambda: given + share[:, None] * (surface() - given))


def _heard(steps: Steps[Denoised]) -> Steps[tuple[Denoised, bool]]:
    """Pass steps on, and note whether the work was asked to finish."""
    request: str | None = None
    finish = False
    try:
        while True:
            try:
                step = steps.send(request)
            except StopIteration as end:
                return end.value, finish
            request = yield step
            finish = finish or request == FINISH
    finally:
        steps.close()

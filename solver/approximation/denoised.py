"""Denoising with the creases that the domain optimisation shows, by itself and as a part of `approximate`.

There noise is removed first, and the result is fitted only on request.

Once a mesh has lost its noise, a sparse fit gains little: what a few functions cannot follow outweighs the noise that
remains.  So the denoised mesh is the result, as a representation without patches, unless a fit is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, Indices
from ..denoising.creases import FindCreases, no_creases
from ..denoising.denoise import Denoised, denoise_with
from ..mesh.objects import given_mesh
from ..patches.observations import checked_weights
from ..progress import FINISH, Progress, Steps, relayed, run_to_end
from ..settings import Settings
from ..surface.metrics import statistics
from .crease_search import find_creases
from .measuring import Deviation


def denoise(
    vertices: Any,
    faces: ArrayLike | list[list[int]] | None = None,
    *,
    noise_level: float | None = None,
    strength: float = 1.0,
    triangles: tuple[Indices, Indices] | None = None,
    sharp_edges: ArrayLike | None = None,
    report: Callable[[Progress], str | None] | None = None,
) -> Denoised:
    """Remove the noise of a mesh but preserve its creases.

    Quadratics h_k are fitted robustly to small patches that no crease crosses.  Each vertex x then moves by the d that
    minimises the weighted mean of (n_k . d - h_k(x))^2 over the tangent planes n_k of its patches, plus a small
    multiple of the squared part of d across its normal: to the surface, onto a crease or into a corner.  The patches
    are guided by filtered normals after Zheng, Fu, Au and Tai, "Bilateral normal filtering for mesh denoising" (2011),
    and on wide smooth sides once more by the first ones and by the creases that a fit finds on what these give.

    Parameters
    ----------
    vertices
        (V, 3) positions in scene units; without `faces` a pair, a mesh of another library or a file, as in
        `approximate`.
    faces
        (F, n) vertex numbers, or a list of polygons.
    noise_level
        Standard deviation of the noise along the surface's normals, in scene units; None estimates it, and leaves a
        clean mesh as it is.
    strength
        Multiplies the noise level, from 0 (nothing moves) to 10.
    triangles
        A known triangulation of the faces: corners (T, 3) and face numbers (T,).
    sharp_edges
        Pairs of vertex numbers, (n, 2), that no patch and no averaged normal reaches across.
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
    given = given_mesh(vertices, faces)
    steps = denoise_steps(
        *(given.vertices, given.faces),
        noise_level=noise_level,
        strength=strength,
        triangles=triangles,
        sharp_edges=sharp_edges,
    )
    return replace(run_to_end(steps, report), given=given)


def denoise_steps(
    vertices: ArrayLike,
    faces: ArrayLike | list[list[int]],
    *,
    noise_level: float | None = None,
    strength: float = 1.0,
    triangles: tuple[Indices, Indices] | None = None,
    sharp_edges: ArrayLike | None = None,
) -> Steps[Denoised]:
    """`denoise` as a generator of `Progress`; closing it cancels, and after `FINISH` it fits fewer patches."""
    return denoise_with(
        *(_finding(Settings()), vertices, faces),
        noise_level=noise_level,
        strength=strength,
        triangles=triangles,
        sharp_edges=sharp_edges,
    )


def _finding(settings: Settings) -> FindCreases:
    """What finds creases on a mesh that has lost most of its noise: as a fit with default settings does."""
    if settings.creases != "auto":
        return no_creases
    return partial(find_creases, settings=Settings(solver=settings.solver).resolved())


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
    steps = denoise_with(
        *(_finding(settings), given.positions, given.faces),
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

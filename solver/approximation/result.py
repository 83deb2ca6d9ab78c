"""The result of an approximation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..fitting.chunks import PatchFit
from ..surface.creases import crease_edges
from ..surface.metrics import domain_jacobians, domain_stretch, flipped_triangles, strongest_patch
from ..surface.representation import Representation
from .denoised import MeshInput
from .oscillation import MeshSurface
from .report import Deviation, Report, Stopwatch, measure, mesh_counts
from .tolerance import ToleranceKept


@dataclass(frozen=True)
class Approximation:
    """A mesh approximated by a sparse surface.

    Attributes
    ----------
    vertices
        The surface at the input's vertices, (V, 3), of the input's floating-point type.
    error
        Distance of each vertex from the input, (V,), scene units.
    patch
        Patch with the largest blending weight at each vertex, (V,); -1 where the input passes through.
    domain_stretch
        Anisotropy of the domain transformation on each input face, (F,).
    measures
        Measures, counts and times.
    representation
        What evaluates the surface anywhere.
    history
        The surface at the input's vertices after each iteration of the patches by themselves, (n, V, 3); None unless
        `Settings.keep_iterations`.
    creases
        Edges that the optimisation treats as creases, pairs of vertices (E, 2); None unless `Settings.mark_creases`.
    """

    vertices: NDArray[np.floating[Any]]
    error: Array
    patch: NDArray[np.int32]
    domain_stretch: Array
    measures: Report
    representation: Representation
    history: Array | None = None
    creases: Indices | None = None

    @cached_property
    def report(self) -> dict[str, Any]:
        """The measures as a dictionary of plain values."""
        return self.measures.as_dict()


def measured_result(
    given: MeshInput,
    surface: MeshSurface,
    points: NDArray[Any],
    representation: Representation,
    iterations: dict[str, list[float]],
    kept: ToleranceKept | None,
    watch: Stopwatch,
) -> Approximation:
    """Measure a finished surface, with its `points` at the vertices (V, 3), against the input."""
    mesh, settings = surface.mesh, surface.settings
    with watch.stage("measure"):
        jacobians, area = domain_jacobians(representation)
        stretch = domain_stretch(representation, jacobians, mesh.polygon_count)
        deviation = fitted = Deviation.from_mesh(representation, points, mesh.vertices)
        if given.source is not None:
            deviation = Deviation.from_mesh(representation, points, given.source)
    error = deviation.at_points
    report = measure(
        representation,
        deviation,
        settings,
        watch,
        surface.runner,
        counts=mesh_counts(mesh),
        flipped_triangles=flipped_triangles(jacobians, area),
        passed_through_vertices=_passed_through(representation, error, given),
        iterations=iterations,
        tolerance=None if kept is None else kept.as_dict(max(error.max(initial=0.0), float(deviation.between.max()))),
        denoise=given.denoising(fitted),
    )
    return Approximation(
        points,
        error,
        strongest_patch(representation),
        stretch,
        report,
        representation,
        _history(representation, surface.fits),
        crease_edges(representation, mesh) if settings.mark_creases else None,
    )


def _passed_through(representation: Representation, error: Array, given: MeshInput) -> int:
    """Number of vertices without a patch; where only noise was removed, of those that did not move."""
    if given.denoised is not None and not representation.patches:
        return int((error == 0.0).sum())
    weight = np.bincount(representation.patch_vertices, weights=representation.weights, minlength=len(error))
    return int((weight <= 0.0).sum())


def _history(representation: Representation, fits: list[PatchFit]) -> Array | None:
    """The blended surface after each iteration, (n, V, 3), where the patches kept their own."""
    histories = [fit.history for fit in fits if fit.history is not None]
    if not histories or len(histories) < len(fits):
        return None
    surfaces = []
    for number in range(max(len(history) for history in histories)):
        values = np.concatenate([history[min(number, len(history) - 1)] for history in histories])
        surfaces.append(representation.blend_at_vertices(values))
    return np.stack(surfaces)

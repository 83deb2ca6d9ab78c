"""From a mesh to its sparse surface: the stages in order."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..fitting.chunks import ChunkTask, PatchFit, chunk_patches, chunk_task
from ..fitting.solution import summed_histories
from ..mesh.triangle_mesh import TriangleMesh, build_mesh
from ..patches.blending import blending_weights
from ..patches.cover import build_cover
from ..patches.observations import MeshObservations, checked_weights
from ..patches.patches import build_patches
from ..patches.splitting import with_domains
from ..progress import FINISH, Progress, Steps, run_to_end, within
from ..settings import Settings
from ..surface.creases import crease_edges
from ..surface.metrics import (
    domain_jacobians,
    domain_stretch,
    flipped_triangles,
    normal_error,
    seam,
    statistics,
    surface_error,
)
from ..surface.representation import Representation
from ..version import VERSION
from .denoised import denoise_first
from .oscillation import overshooting
from .preview import Preview
from .result import Approximation
from .runner import Crew, crew_for
from .sweeps import Blend, sweep
from .tolerance import RefinedSurface, keep_tolerance

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SOLVE_STARTS, SOLVE_ENDS, SWEEPS_END = 0.08, 0.75, 0.93
"""Shares of the progress bar at which fitting the patches begins and ends, and the sweeps end."""


STAGES = ("cover", "domains", "solve", "sweeps", "refine", "blend", "measure")
"""The stages whose seconds stand in the report."""


class Stopwatch:
    """Seconds spent in each named stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._start = time.perf_counter()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time of the block to the stage `name`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def total(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self._start


def approximate(
    vertices: ArrayLike,
    faces: ArrayLike | list[list[int]],
    settings: Settings | None = None,
    *,
    triangles: tuple[Indices, Indices] | None = None,
    weights: Array | None = None,
    executor: Executor | None = None,
    report: Callable[[Progress], str | None] | None = None,
) -> Approximation:
    """Approximate a mesh by overlapping sparse patches over optimised domains (sections 3 and 4).

    Each patch minimises, over at most s coefficients c_j a coordinate and its planar domain U, with U0 the initial one,
    sum_i |b_i - sum_j c_j p_j(u_i)|^2 + beta1 |U - U0|^2 + beta2 sum_t A_t ((s1 - 1)^2 + (s2 - 1)^2)  (eqs. 2 to 4),
    where s1, s2 are the singular values of U0 -> U on triangle t.  The patches are averaged, and sweeps refit each to
    what the others leave (eq. 6).

    Parameters
    ----------
    vertices
        (V, 3), scene units.  The result has the same floating-point type, and errors are measured on it.
    faces
        (F, n) vertex numbers, or a list of polygons.
    settings
        What to do; the defaults where None.
    triangles
        A triangulation of the faces that is known already: corners (T, 3) and face numbers (T,).
    weights
        Observation weight of each vertex in [0, 1], (V,); a vertex of weight 0 passes through unchanged.
    executor
        Where patches are solved; see `Settings.workers` where None.
    report
        Called with each `Progress`.

    Returns
    -------
    Approximation

    Raises
    ------
    InputError
        When the mesh cannot be worked on, in one sentence.

    Examples
    --------
    >>> from sparse_surface.solver import Settings, approximate
    >>> result = approximate(vertices, faces, Settings(ring=4, degree=8))
    >>> result.vertices.shape == vertices.shape, result.error.shape == (len(vertices),)
    (True, True)
    """
    steps = approximate_steps(vertices, faces, settings, triangles=triangles, weights=weights, executor=executor)
    return run_to_end(steps, report)


def approximate_steps(
    vertices: ArrayLike,
    faces: ArrayLike | list[list[int]],
    settings: Settings | None = None,
    *,
    triangles: tuple[Indices, Indices] | None = None,
    weights: Array | None = None,
    executor: Executor | None = None,
) -> Steps[Approximation]:
    """`approximate` as a generator of `Progress`; closing it cancels, sending `FINISH` ends it early."""
    settings = (settings or Settings()).resolved()
    source = np.asarray(vertices)
    with crew_for(settings.workers, len(source) if source.ndim else 0, executor) as crew:
        if settings.denoise == "off":
            return (yield from _approximate(source, faces, settings, triangles, weights, crew))

        def fit(positions: NDArray[Any], held: Array | None) -> Steps[Approximation]:
            return _approximate(positions, faces, settings, triangles, held, crew)

        return (yield from denoise_first(source, faces, settings, triangles, weights, fit))


def _approximate(
    source: NDArray[Any],
    faces: ArrayLike | list[list[int]],
    settings: Settings,
    triangles: tuple[Indices, Indices] | None,
    observation_weights: Array | None,
    crew: Crew,
) -> Steps[Approximation]:
    watch = Stopwatch()
    stored = source.dtype if source.dtype.kind == "f" else np.dtype(np.float64)
    yield Progress("Reading the mesh", 0.0)
    with watch.stage("cover"):
        mesh = build_mesh(source, faces, triangles)
        mesh, observation_weights = _held_vertices(mesh, observation_weights, settings.pin_boundary)
        patches = build_patches(mesh, build_cover(mesh, settings.ring), settings.ring)
    yield Progress("Parameterising patches", 0.02, f"{len(patches)} patches")
    with watch.stage("domains"):
        patches, domains = with_domains(mesh, patches, settings)
        blend = blending_weights(mesh, patches, settings.blending)
    inside = settings.observations == "centroids"
    observations = MeshObservations(mesh, patches, blend, settings.blending, observation_weights, inside)
    surface = Blend(observations)
    preview = Preview(mesh.vertices, patches, domains, blend)
    with watch.stage("solve"):
        fits, hurry = yield from solve_patches(surface, domains, settings, crew, preview)
    iterations = iteration_measures(fits)
    if inside and not hurry:
        with watch.stage("solve"):
            observations = yield from steady_patches(mesh, observations, domains, fits, settings, crew)
    if settings.sweeps and not hurry:
        with watch.stage("sweeps"):
            surface = blend_of(observations, fits) if observations is not surface.observations else surface
            yield from sweep_patches(surface, domains, fits, settings, crew, preview)
            if inside:
                yield from steady_patches(mesh, observations, domains, fits, settings, crew)
    refined = RefinedSurface(mesh, patches, blend, fits)
    kept: dict[str, Any] | None = None
    if settings.tolerance and settings.blending == "partition":
        with watch.stage("refine"):
            rounds = keep_tolerance(refined, settings, observation_weights, crew.run)
            kept = yield from within(rounds, SWEEPS_END, 0.97)
    representation = refined.representation(settings)
    yield Progress("Blending", 0.97)
    with watch.stage("blend"):
        points = representation.at_vertices()
    yield Progress("Measuring", 0.98, surface=points.copy)
    return _result(mesh, representation, points.astype(stored), iterations, refined.fits, settings, kept, crew, watch)


def _held_vertices(
    mesh: TriangleMesh, weights: ArrayLike | None, pin_boundary: bool
) -> tuple[TriangleMesh, Array | None]:
    """Let vertices of weight zero, and those of open borders on request, pass through."""
    checked = checked_weights(weights, len(mesh.vertices))
    held = np.zeros(len(mesh.vertices), dtype=bool) if checked is None else checked == 0.0
    if pin_boundary:
        held[mesh.node_vertex[mesh.border]] = True
    return replace(mesh, passed_through=mesh.passed_through | held), checked


def solve_patches(
    surface: Blend, domains: Array, settings: Settings, crew: Crew, preview: Preview | None = None
) -> Steps[tuple[list[PatchFit], bool]]:
    """Fit every patch by itself; returns the fits and whether the rest was hurried on request."""
    count = len(surface.patches)
    fits: list[PatchFit | None] = [None] * count
    end = SOLVE_ENDS if settings.sweeps else SWEEPS_END
    hurried = replace(settings, iterations=0)
    state = {"hurry": False}

    def tasks() -> Iterator[ChunkTask]:
        for chunk in chunk_patches(surface.observations, np.arange(count), settings.channels):
            yield chunk_task(surface.observations, domains, hurried if state["hurry"] else settings, chunk)

    shown = preview.of(surface, fits) if preview is not None else None
    yield Progress("Solving patches", SOLVE_STARTS, f"0 of {count} patches", shown)
    done = 0
    for task, fitted in crew.run(tasks()):
        for patch, fit in zip(task.patches, fitted, strict=True):
            fits[patch] = fit
            surface.add(int(patch), fit)
        done += len(fitted)
        share = SOLVE_STARTS + (end - SOLVE_STARTS) * done / count
        request = yield Progress("Solving patches", share, f"{done} of {count} patches", shown)
        state["hurry"] = state["hurry"] or request == FINISH
    return [fit for fit in fits if fit is not None], state["hurry"]


def steady_patches(
    mesh: TriangleMesh,
    observations: MeshObservations,
    domains: Array,
    fits: list[PatchFit],
    settings: Settings,
    crew: Crew,
) -> Steps[MeshObservations]:
    """Fit patches that swing between their observations anew to more of them; changes `fits`.

    Returns the observations with those that were added.
    """
    swinging = overshooting(mesh, observations, fits, settings)
    if not swinging.any():
        return observations
    denser = observations.with_dense(swinging)
    chunks = chunk_patches(denser, np.flatnonzero(swinging), settings.channels)
    for task, fitted in crew.run(chunk_task(denser, domains, settings, chunk) for chunk in chunks):
        for patch, fit in zip(task.patches, fitted, strict=True):
            fits[patch] = fit
        yield Progress("Solving patches", SOLVE_ENDS, "patches that swing between their observations")
    return denser


def blend_of(observations: MeshObservations, fits: list[PatchFit]) -> Blend:
    """Return the surface of all patches at these observations."""
    surface = Blend(observations)
    for patch, fit in enumerate(fits):
        surface.add(patch, fit)
    return surface


def sweep_patches(
    surface: Blend, domains: Array, fits: list[PatchFit], settings: Settings, crew: Crew, preview: Preview | None = None
) -> Steps[None]:
    """Make the patches consistent; changes `fits`."""
    shown = preview.of(surface, fits) if preview is not None else None
    total = settings.sweeps * len(fits)
    done = 0
    for number in range(settings.sweeps):
        for count in sweep(surface, domains, fits, settings, crew.run):
            done += count
            share = SOLVE_ENDS + (SWEEPS_END - SOLVE_ENDS) * done / total
            request = yield Progress("Blending patches", share, f"sweep {number + 1}", shown)
            if request == FINISH:
                return


def _result(
    mesh: TriangleMesh,
    representation: Representation,
    points: NDArray[Any],
    iterations: dict[str, Any],
    fits: list[PatchFit],
    settings: Settings,
    kept: dict[str, Any] | None,
    crew: Crew,
    watch: Stopwatch,
) -> Approximation:
    with watch.stage("measure"):
        error = np.linalg.norm(points.astype(np.float64) - mesh.vertices, axis=1)
        jacobians, area = domain_jacobians(representation)
        on_surface = surface_error(representation)
        size = float(np.ptp(mesh.vertices[np.unique(mesh.triangles)], axis=0).max())
        vertex_error, inside = statistics(error), statistics(on_surface.ravel())
        covered = np.bincount(representation.patch_vertices, weights=representation.weights, minlength=len(error)) > 0.0
        measures = {
            "patches": representation.patches,
            "flipped_triangles": flipped_triangles(jacobians, area),
            "passed_through_vertices": int((~covered).sum()),
            "vertex_error": vertex_error,
            "surface_error": inside,
            "relative": {
                "vertex_rms": vertex_error["rms"] / size,
                "vertex_max": vertex_error["max"] / size,
                "surface_rms": inside["rms"] / size,
                "surface_max": inside["max"] / size,
            },
            "seam_max": seam(representation),
            "representation_bytes": len(representation.stored),
            "normal_error_degrees": normal_error(mesh.vertices, points.astype(np.float64), mesh.triangles),
            **iterations,
        }
        stretch = domain_stretch(representation, jacobians, mesh.polygon_count)
    seconds = {stage: watch.seconds.get(stage, 0.0) for stage in STAGES}
    report = {
        "version": VERSION,
        "method": settings.method,
        "settings": settings.as_dict(),
        "input": {
            "vertices": len(mesh.vertices),
            "faces": mesh.polygon_count,
            "triangles": len(mesh.triangles),
            "components": mesh.component_count,
            "bounding_box_longest_side": size,
        },
        **measures,
        **({} if kept is None else {"tolerance": {**kept, "achieved": max(vertex_error["max"], inside["max"])}}),
        "seconds": {**seconds, "total": watch.total()},
        "peak_memory_mb": crew.peak_memory_mb(),
        "workers": crew.workers,
    }
    history = _history(representation, fits)
    creases = crease_edges(representation, mesh) if settings.mark_creases else None
    strongest = strongest_patch(representation)
    return Approximation(points, error, strongest, stretch, report, representation, history, creases)


def iteration_measures(fits: list[PatchFit]) -> dict[str, Any]:
    """What is known of each iteration of the patches by themselves, before sweeps and blending.

    The energy is in the patches' own scales; `patch_rms` is the root mean square distance from the data, scene units.
    """
    energy = summed_histories([fit.energy for fit in fits])
    squares = summed_histories([fit.squared_error for fit in fits])
    observations = max(sum(len(fit.values) for fit in fits), 1)
    patch_rms = np.sqrt(squares / observations)
    return {"energy": energy.tolist(), "iterations": {"energy": energy.tolist(), "patch_rms": patch_rms.tolist()}}


def _history(representation: Representation, fits: list[PatchFit]) -> Array | None:
    """The blended surface after each iteration, (n, V, 3), where the patches kept their own."""
    histories = [fit.history for fit in fits if fit.history is not None]
    if not histories or len(histories) < len(fits):
        return None
    count = max(len(history) for history in histories)
    surfaces = []
    for number in range(count):
        values = np.concatenate([history[min(number, len(history) - 1)] for history in histories])
        surfaces.append(representation.blend_at_vertices(values))
    return np.stack(surfaces)


def strongest_patch(representation: Representation) -> NDArray[np.int32]:
    """Patch with the largest blending weight at every vertex, the first one of equals; -1 where none has weight."""
    strongest = np.full(len(representation.vertices), -1, dtype=np.int32)
    patch = np.repeat(np.arange(representation.patches), np.diff(representation.vertex_offsets))
    order = np.lexsort((-patch, representation.weights))
    order = order[representation.weights[order] > 0.0]
    strongest[representation.patch_vertices[order]] = patch[order]
    return strongest

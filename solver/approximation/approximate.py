"""From a mesh to its sparse surface: the steps of the paper, in order."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, Indices
from ..fitting.chunks import PatchFit
from ..mesh.input_checks import as_positions, checked_edges
from ..mesh.objects import given_mesh
from ..mesh.potential_creases import cut_along_marked
from ..mesh.triangle_mesh import TriangleMesh, build_mesh
from ..patches.observations import checked_weights
from ..patches.patches import Patches
from ..patches.splitting import with_domains
from ..processes.threads import on_one_thread
from ..progress import FINISH, Progress, Steps, run_to_end, within
from ..settings import Settings
from ..surface.bounds import error_bounds
from ..surface.creases import crease_edges
from ..surface.metrics import domain_changes, faces_turned, strongest_patch
from ..surface.representation import Representation
from .containment import kept_inside
from .crease_search import cut_along_creases, looking, observing
from .denoised import MeshInput, remove_noise
from .measuring import Deviation, measure, measured_iterations
from .oscillation import MeshSurface, oscillating_on_mesh
from .patched_surface import PatchedSurface, cover
from .preview import Preview
from .report import Stopwatch, noting_early_end
from .result import Approximation
from .runner import ChunkRunner, chunk_runner
from .tolerance import ToleranceKept, keep_tolerance, lowered_to
from .welded import held_together

CUT_ENDS, SOLVE_STARTS, SOLVE_ENDS, SWEEPS_END = 0.05, 0.08, 0.75, 0.93
"""Shares of the progress bar at which the mesh is cut along creases, fitting the patches begins and ends, and the
sweeps end."""


def approximate(
    vertices: Any,
    faces: ArrayLike | list[list[int]] | None = None,
    settings: Settings | None = None,
    *,
    triangles: tuple[Indices, Indices] | None = None,
    weights: Array | None = None,
    sharp_edges: ArrayLike | None = None,
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
        Without `faces`: a pair of vertices and faces, a mesh of trimesh, PyVista, Open3D or meshio, or a file that
        trimesh or meshio reads; `result.as_()` gives back what was given, with the surface's vertices.
    faces
        (F, n) vertex numbers, or a list of polygons.
    settings
        What to do; the defaults where None.
    triangles
        A triangulation of the faces that is known already: corners (T, 3) and face numbers (T,).
    weights
        Observation weight of each vertex in [0, 1], (V,); a vertex of weight 0 passes through unchanged.  Denoising
        moves a vertex by that share.
    sharp_edges
        Edges that the mesh marks as sharp, pairs of vertices (n, 2): the creases where `Settings.creases` is "marked".
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
    given = given_mesh(vertices, faces)
    mesh = MeshInput(as_positions(given.vertices), given.faces, triangles, weights, sharp_edges=sharp_edges)
    return replace(run_to_end(_steps(mesh, settings, executor), report), given=given)


def approximate_steps(
    vertices: ArrayLike,
    faces: ArrayLike | list[list[int]],
    settings: Settings | None = None,
    *,
    triangles: tuple[Indices, Indices] | None = None,
    weights: Array | None = None,
    sharp_edges: ArrayLike | None = None,
    executor: Executor | None = None,
) -> Steps[Approximation]:
    """`approximate` as a generator of `Progress`; closing it cancels, sending `FINISH` ends it early."""
    given = MeshInput(as_positions(vertices), faces, triangles, weights, sharp_edges=sharp_edges)
    return (yield from _steps(given, settings, executor))


@on_one_thread
def _steps(given: MeshInput, settings: Settings | None, executor: Executor | None) -> Steps[Approximation]:
    settings, watch = Settings.given(settings).resolved(), Stopwatch()
    welded = held_together(given, settings)
    given = given if welded is None else welded.mesh
    vertex_count = len(given.positions) if given.positions.ndim else 0
    with chunk_runner(settings, vertex_count, executor) as runner:
        steps = noting_early_end(_all_steps(given, settings, runner, watch))
        return (yield from steps if welded is None else welded.spread(steps))


def _all_steps(given: MeshInput, settings: Settings, runner: ChunkRunner, watch: Stopwatch) -> Steps[Approximation]:
    """Denoise first if asked, then approximate."""
    if settings.denoise == "off":
        return (yield from _approximate(given, settings, runner, watch))
    start = 0.9 if settings.denoise == "only" else 0.4
    with watch.stage("denoise"):
        given = yield from within(remove_noise(given, settings), 0.0, start)
    return (yield from within(_approximate(given, settings, runner, watch), start, 1.0))


def _approximate(given: MeshInput, settings: Settings, runner: ChunkRunner, watch: Stopwatch) -> Steps[Approximation]:
    stored = given.positions.dtype if given.positions.dtype.kind == "f" else np.dtype(np.float64)
    inside = settings.observations == "centroids"
    hurry = (yield Progress("Reading the mesh", 0.0)) == FINISH
    with watch.stage("cover"):
        mesh = build_mesh(given.positions, given.faces, given.triangles)
        mesh, weights = _held_vertices(mesh, given.weights, settings.pin_boundary)
        counts = {"components": mesh.component_count, "coincident_vertices": mesh.coincident_vertices}
    with watch.stage("creases"):
        searched = _cut(mesh, given, settings, weights, runner, hurry)
        mesh, hurry = yield from within(searched, 0.0, CUT_ENDS)
    with watch.stage("cover"):
        patches = cover(mesh, settings.ring, runner.each)
    request = yield Progress("Parameterising patches", CUT_ENDS, f"{len(patches)} patches")
    hurry = hurry or request == FINISH
    with watch.stage("domains"):
        surface = _covered(mesh, patches, settings, weights, runner)
        del patches  # the surface has its own, of which some were split
    with watch.stage("solve"):
        end = SOLVE_ENDS if settings.sweeps else SWEEPS_END
        hurry = yield from within(surface.fit(hurry=hurry), SOLVE_STARTS, end)
        iterations = measured_iterations(surface.fits)
        if inside and not hurry:
            yield from _without_oscillation(surface, end)
    if settings.sweeps and not hurry:
        with watch.stage("sweeps"):
            hurry = yield from _swept(surface)
            if inside and not hurry:
                yield from _without_oscillation(surface, SWEEPS_END)
    kept = None
    if settings.tolerance and settings.blending == "partition" and not hurry:
        with watch.stage("refine"):
            kept = yield from within(keep_tolerance(surface), SWEEPS_END, 0.97)
    request = yield Progress("Bounding the error", 0.97, surface=lambda: surface.representation().at_vertices())
    hurry = hurry or request == FINISH
    found = yield from _finished(surface, kept, iterations, hurry, watch)
    return _result(given, counts, surface, replace(found, points=found.points.astype(stored)), watch)


def _finished(
    surface: MeshSurface,
    kept: ToleranceKept | None,
    iterations: dict[str, list[float]],
    hurry: bool,
    watch: Stopwatch,
) -> Steps[Fitted]:
    """Bound the error of a fitted surface and evaluate it; only its settings are needed afterwards."""
    settings = surface.settings
    surface.forget_observations()
    with watch.stage("measure"):
        contained, bounds = _bounded(surface, settings.observations == "centroids", hurry)
        representation = surface.representation()
        if kept is not None and bounds is not None:
            bounds = lowered_to(settings.tolerance, bounds, representation)
    yield Progress("Blending", 0.98)
    with watch.stage("blend"):
        points = representation.at_vertices()
    yield Progress("Measuring", 0.985, surface=points.copy)
    history = _history(representation, surface.fits)
    surface.forget_fits()
    return Fitted(representation, points, bounds, iterations, kept, contained, history)


def _held_vertices(
    mesh: TriangleMesh, weights: ArrayLike | None, pin_boundary: bool
) -> tuple[TriangleMesh, Array | None]:
    """Let vertices of weight zero, and those of open borders on request, pass through."""
    checked = checked_weights(weights, len(mesh.vertices))
    held = np.zeros(len(mesh.vertices), dtype=bool) if checked is None else checked == 0.0
    if pin_boundary:
        held[mesh.node_vertex[mesh.border]] = True
    return replace(mesh, passed_through=mesh.passed_through | held), checked


def _bounded(surface: MeshSurface, inside: bool, hurry: bool) -> tuple[int, tuple[float, float] | None]:
    """Return how many vertices pass through to stay inside the input's box, and the bounds of the error.

    In a hurry there are none: they take most of the time that is left, and grow with the mesh.
    """
    if inside:
        return kept_inside(surface, bounded=not hurry)
    return 0, None if hurry else error_bounds(surface.representation(), each=surface.runner.each)


def _cut(
    mesh: TriangleMesh,
    given: MeshInput,
    settings: Settings,
    weights: Array | None,
    runner: ChunkRunner,
    hurry: bool,
) -> Steps[tuple[TriangleMesh, bool]]:
    """Cut the mesh along its creases, marked ones or those that the domain optimisation shows, unless in a hurry.

    Also says whether there is a hurry afterwards.
    """
    if settings.creases == "marked":
        return cut_along_marked(mesh, checked_edges(given.sharp_edges, len(mesh.vertices))), hurry
    if settings.creases == "off" or hurry:
        return mesh, hurry
    look = looking(settings)
    return (yield from cut_along_creases(mesh, observing(mesh, look, weights), look, runner))


def _covered(
    mesh: TriangleMesh, patches: Patches, settings: Settings, weights: Array | None, runner: ChunkRunner
) -> MeshSurface:
    """Map the patches to the plane."""
    observe = observing(mesh, settings, weights)
    surface = PatchedSurface(mesh, *with_domains(mesh, patches, settings, runner.each), observe, settings, runner)
    surface.preview = Preview(mesh, surface.patches, surface.domains, surface.blending)
    return surface


def _without_oscillation(surface: MeshSurface, fraction: float) -> Steps[None]:
    for _ in surface.refit_oscillating(oscillating_on_mesh):
        yield Progress("Solving patches", fraction, "patches that oscillate between their observations")


def _swept(surface: MeshSurface) -> Steps[bool]:
    """Make the patches consistent; returns whether `FINISH` was sent."""
    for number in range(surface.settings.sweeps):
        start, end = (
            SOLVE_ENDS + (SWEEPS_END - SOLVE_ENDS) * n / surface.settings.sweeps for n in (number, number + 1)
        )
        if (yield from within(surface.sweep("Blending patches", f"sweep {number + 1}"), start, end)):
            return True
    return False


@dataclass(frozen=True)
class Fitted:
    """A surface that is finished but for its measures.

    Attributes
    ----------
    representation, points
        The surface, and its points at the vertices, (V, 3).
    bounds
        Of its largest error against what was fitted (see `error_bounds`); None where it was ended early.
    iterations
        What `measured_iterations` says.
    kept, contained
        What a tolerance took, None without one, and how many vertices were let through to stay inside the input's box.
    history
        See `Approximation`.
    """

    representation: Representation
    points: NDArray[Any]
    bounds: tuple[float, float] | None
    iterations: dict[str, list[float]]
    kept: ToleranceKept | None
    contained: int
    history: Array | None


def _result(
    given: MeshInput, counts: dict[str, int], surface: MeshSurface, found: Fitted, watch: Stopwatch
) -> Approximation:
    """Measure a finished surface against the input; `counts` are of the mesh before it was cut along creases."""
    representation, points, kept, mesh = found.representation, found.points, found.kept, surface.mesh
    each = surface.runner.each
    with watch.stage("measure"):
        stretch, flipped = domain_changes(representation, mesh.polygon_count, each)
        deviation = fitted = Deviation.from_mesh(representation, points, mesh.vertices, found.bounds, each)
        if given.source is not None:
            away = None if found.bounds is None else error_bounds(representation, given.source, each=each)
            deviation = Deviation.from_mesh(representation, points, given.source, away, each)
        before = mesh.vertices if given.source is None else given.source
        turned = faces_turned(before, points.astype(np.float64), mesh.face_offsets, mesh.face_corners)
    error = deviation.at_points
    report = measure(
        surface,
        representation,
        deviation,
        watch,
        flipped_triangles=flipped,
        passed_through_vertices=_passed_through(representation, error, given),
        vertices_reproduced=found.contained + (0 if kept is None else kept.vertices_reproduced),
        faces_turned=turned,
        iterations=found.iterations,
        counts=counts,
        tolerance=None if kept is None else kept.as_dict(fitted.achieved),
        denoise=given.denoising(fitted),
    )
    return Approximation(
        points,
        error,
        strongest_patch(representation),
        stretch,
        report,
        representation,
        found.history,
        _creases(representation, surface),
    )


def _creases(representation: Representation, surface: MeshSurface) -> Indices | None:
    """Edges along which the surface was cut; without any, on request those that the domain shows."""
    if len(representation.creases):
        return representation.creases
    if not surface.settings.mark_creases:
        return None
    return crease_edges(representation, surface.mesh, each=surface.runner.each)


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

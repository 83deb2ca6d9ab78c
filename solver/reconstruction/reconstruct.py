"""Surfaces from point clouds (section 5, Fig. 13): points as observations of patches over a coarse base mesh.

Every point is projected on the base and keeps its barycentric coordinates there; the domains' degrees of freedom are
the base's vertices.  When the patches stand, points are projected anew on the surface itself (parameter correction,
Hoschek 1988): what is left of a point's residual is then its distance from the surface, and the patches are fitted
again from where they are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from ..approximation.approximate import SOLVE_ENDS, STAGES, SWEEPS_END, Stopwatch, iteration_measures
from ..approximation.runner import Crew, crew_for
from ..errors import InputError
from ..mesh.closest_points import Footpoints
from ..mesh.projection import project, walk
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import FINISH, Progress, Steps, run_to_end, within
from ..settings import CloudSettings, Settings
from ..surface.metrics import domain_jacobians, flipped_triangles, seam, statistics
from ..surface.representation import Representation
from ..version import VERSION
from .base import checked_base, drawn_to_points, refuse_distant, snapped_to_creases
from .cloud_surface import CloudSurface
from .geometry import CloudGeometry, analyse
from .noise import iterations_for_noise, ring_for_noise
from .observations import ObservedCloud, filled, fillers
from .oscillation import Planes
from .robust_weights import robust_weights, spread

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

FEWEST_POINTS = 4
CORRECTION_STEPS = 2
MEASURING_STEPS = 5
COARSER = 2
"""By how much the rings of the coarse fit are larger that fills places without points."""

ROBUST_ROUNDS = 2
ROBUST_ITERATIONS = 2
CREASE_WEIGHT = 1.0
"""Weight of an estimated crease point, beside that of a point of the cloud."""

WALK_TOLERANCE = 1e-3
"""Steps that change barycentric coordinates by less are not worth another evaluation."""

SMALLEST_SCALE = 0.1
"""Robust weights take no scale below this share of the spacing: a crease rounded off is no outlier."""


@dataclass(frozen=True)
class Reconstruction:
    """A surface fitted to P points.

    Attributes
    ----------
    vertices
        The surface at the base's vertices, (V, 3), scene units.
    error
        Distance of each point from the surface, (P,), scene units.
    triangle, barycentric
        The surface's point nearest to each point: triangle of the base (P,) and barycentric coordinates (P, 3).
    weights
        How much each point counted, in [0, 1], (P,).
    report
        Measures, counts and times; plain values only.
    representation
        What evaluates the surface anywhere on the base.
    """

    vertices: Array
    error: Array
    triangle: Indices
    barycentric: Array
    weights: Array
    report: dict[str, Any]
    representation: Representation

    def error_near(self, points: Array, positions: Array) -> Array:
        """Error of the cloud around positions (N, 3), for a heat map of the surface: that of the four nearest points,
        (N,).
        """
        count = min(4, len(points))
        distance, nearest = cKDTree(points).query(positions, k=count)
        share = 1.0 / (distance.reshape(len(positions), count) + 1e-9 * float(np.ptp(points, axis=0).max()) + 1e-300)
        values = self.error[nearest.reshape(len(positions), count)]
        result: Array = (share * values).sum(axis=1) / share.sum(axis=1)
        return result


def reconstruct(
    points: ArrayLike,
    base_vertices: ArrayLike,
    base_faces: ArrayLike | Sequence[Sequence[int]],
    settings: Settings | None = None,
    cloud: CloudSettings | None = None,
    *,
    executor: Executor | None = None,
    report: Callable[[Progress], str | None] | None = None,
) -> Reconstruction:
    """Fit a sparse surface over a base mesh to a point cloud.

    Minimises what `approximate` does, with the points as observations at their projections onto the base.

    Parameters
    ----------
    points
        (P, 3), scene units.
    base_vertices, base_faces
        A coarse mesh near the points: (V, 3), and (F, n) vertex numbers or a list of polygons.
    settings
        How patches are fitted; `Settings.ring` does not count here, and a tolerance is only compared with what is
        reached.
    cloud
        How the points are observed.
    executor
        Where patches are solved; see `Settings.workers` where None.
    report
        Called with each `Progress`.

    Raises
    ------
    InputError
        When points or base cannot be worked on, in one sentence.

    Examples
    --------
    >>> from sparse_surface.solver import reconstruct
    >>> result = reconstruct(points, base_vertices, base_faces)
    >>> result.error.shape == (len(points),)
    True
    """
    return run_to_end(reconstruct_steps(points, base_vertices, base_faces, settings, cloud, executor=executor), report)


def reconstruct_steps(
    points: ArrayLike,
    base_vertices: ArrayLike,
    base_faces: ArrayLike | Sequence[Sequence[int]],
    settings: Settings | None = None,
    cloud: CloudSettings | None = None,
    *,
    executor: Executor | None = None,
) -> Steps[Reconstruction]:
    """`reconstruct` as a generator of `Progress`; closing it cancels, sending `FINISH` ends it early."""
    settings = replace((settings or Settings()).resolved(), keep_iterations=False, denoise="off")
    checked = checked_points(points)
    base = checked_base(base_vertices, base_faces)
    refuse_distant(checked, base)
    with crew_for(settings.workers, len(checked), executor) as crew:
        return (yield from _Work(checked, base, settings, cloud or CloudSettings(), crew).steps())


def checked_points(points: ArrayLike) -> Array:
    """Return points as an array (P, 3).

    Raises
    ------
    InputError
        When there are fewer than four, or one is not finite.
    """
    try:
        array = np.array(points, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("The points must be an array of three numbers each.") from None
    if array.size and (array.ndim != 2 or array.shape[1] != 3):
        raise InputError(f"The points must be an array of three numbers each, not of shape {array.shape}.")
    if len(array) < FEWEST_POINTS:
        raise InputError(f"A surface needs at least {FEWEST_POINTS} points; there are {len(array)}.")
    wrong = ~np.isfinite(array).all(axis=1)
    if wrong.any():
        raise InputError(f"Point {int(np.argmax(wrong))} has a coordinate that is not a finite number.")
    if float(np.ptp(array, axis=0).max()) == 0.0:
        raise InputError("All the points are at one place.")
    return array


def refuse_flat(points: Array) -> None:
    """Refuse points from which no base can be made.

    Raises
    ------
    InputError
        When they lie on a line or in a plane.
    """
    sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if sizes[1] <= 1e-6 * sizes[0]:
        raise InputError("All the points lie on one line: choose a base mesh for them.")
    if sizes[2] <= 1e-6 * sizes[0]:
        raise InputError("All the points lie in one plane: choose a base mesh for them.")


class _Work:
    """One reconstruction under way."""

    def __init__(self, points: Array, base: TriangleMesh, settings: Settings, cloud: CloudSettings, crew: Crew) -> None:
        self.points, self.base, self.settings, self.cloud, self.crew = points, base, settings, cloud, crew
        self.watch = Stopwatch()
        self.weights = np.ones(len(points))

    def steps(self) -> Steps[Reconstruction]:
        yield Progress("Looking at the points", 0.0)
        with self.watch.stage("cover"):
            self.geometry = self._geometry()
        yield Progress("Fitting the base", 0.02)
        with self.watch.stage("cover"):
            self.mesh = self._fitted_base()
            observed = self._observed()
        yield Progress("Choosing the patches", 0.05)
        with self.watch.stage("cover"):
            self.settings = self._adapted_settings(observed)
        observed = yield from within(self._filled(observed), 0.05, 0.06)
        with self.watch.stage("domains"):
            self.surface = CloudSurface(self.mesh, observed, self.settings, self.crew)
        if not len(self.surface.patches):
            raise InputError("The base has no place for a patch: its triangles hang together nowhere.")
        if self.cloud.robust != "none":
            yield from within(self._first_weights(), 0.06, 0.08)
        yield from self._fit()
        yield Progress("Measuring", 0.95)
        return self._result(self.surface.representation())

    def _geometry(self) -> CloudGeometry:
        geometry = analyse(self.points)
        return replace(geometry, noise=self.cloud.noise) if self.cloud.noise else geometry

    def _fitted_base(self) -> TriangleMesh:
        if not self.cloud.fit_base:
            return self.base
        fitted = drawn_to_points(self.base, self.points, self.weights)
        if self.cloud.robust != "none":
            feet = project(self.points, fitted)
            away = np.linalg.norm(feet.on(fitted.vertices, fitted.triangles) - self.points, axis=1)
            fitted = drawn_to_points(self.base, self.points, self._robust(away))
        return snapped_to_creases(fitted, self._creases())

    def _creases(self) -> Array:
        return self.geometry.creases if self.cloud.creases else np.zeros((0, 3))

    def _observed(self) -> ObservedCloud:
        creases = self._creases()
        points = np.concatenate([self.points, creases])
        weights = np.concatenate([self.weights, np.full(len(creases), CREASE_WEIGHT)])
        return ObservedCloud(points, project(points, self.mesh), weights, self.geometry.noise)

    def _adapted_settings(self, observed: ObservedCloud) -> Settings:
        """Patch radius and iterations as the noise allows."""
        ring = self.cloud.ring or ring_for_noise(self.mesh, observed, self.geometry, self.settings)
        reach = ring * float(np.linalg.norm(np.diff(self.mesh.vertices[self.mesh.edges], axis=1), axis=2).mean())
        iterations = iterations_for_noise(self.settings, self.geometry.noise / reach)
        sweeps = max(self.settings.sweeps, self.cloud.corrections)
        return replace(self.settings, ring=ring, iterations=iterations, sweeps=sweeps)

    def _filled(self, observed: ObservedCloud) -> Steps[ObservedCloud]:
        """Fill triangles with hardly any points from a coarse fit of larger patches, which reach to where there are
        some.
        """
        places = fillers(observed, self.mesh)
        if not len(places.triangle):
            return observed
        on_base = filled(observed, places, places.on(self.mesh.vertices, self.mesh.triangles))
        settings = replace(self.settings, ring=self.settings.ring + COARSER, iterations=0, sweeps=0)
        with self.watch.stage("cover"):
            coarse = CloudSurface(self.mesh, on_base, settings, self.crew)
            yield from coarse.solve()
            surface = coarse.representation()
            return filled(observed, places, surface.evaluate(places.triangle, places.barycentric))

    def _first_weights(self) -> Steps[None]:
        """Tell outliers from a few coarse fits: they must not choose the functions."""
        few = min(ROBUST_ITERATIONS, self.settings.iterations)
        coarse = CloudSurface(
            self.mesh, self.surface.observed, replace(self.settings, iterations=few, sweeps=0), self.crew
        )
        with self.watch.stage("solve"):
            for number in range(ROBUST_ROUNDS):
                yield from within(coarse.solve(), number / ROBUST_ROUNDS, (number + 1) / ROBUST_ROUNDS)
                feet = coarse.observed.feet
                on_surface = coarse.representation().evaluate(feet.triangle, feet.barycentric)
                away = np.linalg.norm(on_surface - coarse.observed.points, axis=1)[: len(self.points)]
                coarse.observe(self._weighted(coarse.observed, away))
        self.surface.observe(coarse.observed)

    def _weighted(self, observed: ObservedCloud, distance: Array) -> ObservedCloud:
        self.weights = self._robust(distance)
        return observed.moved(observed.feet, self.weights)

    def _robust(self, distance: Array) -> Array:
        scale = max(spread(distance), self.geometry.noise, SMALLEST_SCALE * self.geometry.spacing)
        return robust_weights(distance, self.cloud.robust, scale)

    def _fit(self) -> Steps[None]:
        planes = Planes(self.points, self.geometry)
        with self.watch.stage("solve"):
            hurry = yield from self.surface.solve()
            self.surface.tame(planes)
        self.iterations = iteration_measures(self.surface.fits)
        rounds = 0 if hurry else self.settings.sweeps
        with self.watch.stage("sweeps"):
            for number in range(rounds):
                if number < self.cloud.corrections:
                    self._correct()
                start = SOLVE_ENDS + (SWEEPS_END - SOLVE_ENDS) * number / rounds
                request = None
                sweep = self.surface.sweep()
                for step in sweep:
                    share = (step.fraction - SOLVE_ENDS) / rounds
                    request = yield Progress("Fitting again", start + share, f"round {number + 1} of {rounds}")
                    if request == FINISH:
                        sweep.close()
                self.surface.tame(planes)
                if request == FINISH:
                    break

    def _correct(self) -> None:
        """Project the points anew, on the surface itself, and weigh them."""
        observed = self.surface.observed
        feet, distance = nearest_on_surface(
            self.surface.representation(), self.mesh, observed.points, observed.feet, CORRECTION_STEPS
        )
        moved = observed.moved(feet, observed.weights)
        if self.cloud.robust != "none":
            moved = self._weighted(moved, distance[: len(self.points)])
        self.surface.observe(moved)

    def _result(self, representation: Representation) -> Reconstruction:
        with self.watch.stage("measure"):
            count = len(self.points)
            feet = self.surface.observed.feet
            start = Footpoints(feet.triangle[:count], feet.barycentric[:count])
            on_surface = representation.evaluate(start.triangle, start.barycentric)
            parametric = np.linalg.norm(on_surface - self.points, axis=1)
            feet, distance = nearest_on_surface(representation, self.mesh, self.points, start, MEASURING_STEPS)
            jacobians, area = domain_jacobians(representation)
            size = float(np.ptp(self.points, axis=0).max())
            at_points, off = statistics(parametric), statistics(distance)
            measures = {
                "patches": representation.patches,
                "flipped_triangles": flipped_triangles(jacobians, area),
                "passed_through_vertices": int(self.surface.patches.passed_through.sum()),
                "vertex_error": at_points,
                "surface_error": off,
                "relative": {
                    "vertex_rms": at_points["rms"] / size,
                    "vertex_max": at_points["max"] / size,
                    "surface_rms": off["rms"] / size,
                    "surface_max": off["max"] / size,
                },
                "seam_max": seam(representation),
                "representation_bytes": len(representation.stored),
                "normal_error_degrees": self._normal_error(representation, feet),
                **self.iterations,
            }
            vertices = representation.at_vertices()
        report = self._report(measures, size)
        return Reconstruction(vertices, distance, feet.triangle, feet.barycentric, self.weights, report, representation)

    def _normal_error(self, representation: Representation, feet: Footpoints) -> float:
        """Mean angle between the surface and the planes of the points' neighbours, degrees."""
        normals, planes = representation.normals(feet.triangle, feet.barycentric), self.geometry.normals
        beside = np.linalg.norm(np.cross(normals, planes), axis=1)
        angle = np.arctan2(beside, np.abs((normals * planes).sum(axis=1)))
        return float(np.degrees(angle).mean())

    def _report(self, measures: dict[str, Any], size: float) -> dict[str, Any]:
        seconds = {name: self.watch.seconds.get(name, 0.0) for name in STAGES}
        return {
            "version": VERSION,
            "method": self.settings.method,
            "settings": self.settings.as_dict(),
            "cloud": self.cloud.as_dict(),
            "input": {
                "points": len(self.points),
                "vertices": len(self.mesh.vertices),
                "faces": self.mesh.polygon_count,
                "triangles": len(self.mesh.triangles),
                "components": self.mesh.component_count,
                "bounding_box_longest_side": size,
                "spacing": self.geometry.spacing,
                "noise": self.geometry.noise,
                "crease_points": len(self._creases()),
                "outliers": int((self.weights < 0.1).sum()),
            },
            **measures,
            "seconds": {**seconds, "total": self.watch.total()},
            "peak_memory_mb": self.crew.peak_memory_mb(),
            "workers": self.crew.workers,
        }


def nearest_on_surface(
    representation: Representation, mesh: TriangleMesh, points: Array, start: Footpoints, steps: int
) -> tuple[Footpoints, Array]:
    """Walk towards the surface's points nearest to `points` (P, 3), each from its own start.

    Returns
    -------
    footpoints, distance
        The nearest places on the way, and how far they are from the points, (P,).
    """
    nearest = np.full(len(points), np.inf)
    triangle, barycentric = start.triangle.copy(), start.barycentric.copy()

    def keep(which: Indices, feet: Footpoints, missing: Array) -> None:
        distance = np.linalg.norm(missing, axis=1)
        closer = distance < nearest[which]
        where = which[closer]
        nearest[where], triangle[where] = distance[closer], feet.triangle[closer]
        barycentric[where] = feet.barycentric[closer]

    def misses(which: Indices, feet: Footpoints) -> tuple[Array, Array]:
        on_surface, tangents = representation.evaluate_with_tangents(feet.triangle, feet.barycentric)
        missing = points[which] - on_surface
        keep(which, feet, missing)
        return missing, tangents.swapaxes(1, 2)

    found, arrived = walk(mesh, start, misses, steps, WALK_TOLERANCE)
    last = np.flatnonzero(~arrived)
    feet = Footpoints(found.triangle[last], found.barycentric[last])
    keep(last, feet, points[last] - representation.evaluate(feet.triangle, feet.barycentric))
    return Footpoints(triangle, barycentric), nearest

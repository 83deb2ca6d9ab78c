"""Surfaces from point clouds (section 5, Fig. 13): points as observations of patches over a coarse base mesh.

Every point is projected on the base and keeps its barycentric coordinates there; the domains' degrees of freedom are
the base's vertices.  Once the patches are fitted, points are projected again, on the surface itself (parameter
correction, Hoschek 1988): what is left of a point's residual is then its distance from the surface, and the patches are
refitted from where they are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..approximation.approximate import SOLVE_ENDS
from ..approximation.measuring import measured_iterations
from ..approximation.patched_surface import OscillationTest, PatchedSurface, cover
from ..approximation.report import Stopwatch, noting_early_end
from ..approximation.runner import ChunkRunner, chunk_runner
from ..arrays import Array
from ..errors import InputError
from ..mesh.closest_points import Footpoints
from ..mesh.objects import given_mesh
from ..mesh.projection import project
from ..mesh.triangle_mesh import TriangleMesh
from ..patches.splitting import with_domains
from ..processes.threads import on_one_thread
from ..progress import Progress, Steps, run_to_end, within
from ..settings import CloudSettings, Settings
from .base import checked_base, drawn_to_points, refuse_distant, snapped_to_creases
from .cleaning import CleanCloud, clean
from .correction import nearest_on_surface
from .geometry import NOISIEST, CloudGeometry, analyse
from .kept_near import kept_near
from .measured import MEASURING_STEPS, measured
from .noise import CLOSER, is_noisy, iterations_for_noise, ring_for_noise
from .noise_bias import WholeSurface, without_bias
from .observations import CloudObservations, ObservedCloud, filled, fillers, held_at_border, observer
from .oscillation import CloudSurface, oscillating_in_cloud
from .refined import LEAST_GAIN, PATIENCE, ROUNDS, Fitted, ToleranceSought, refined_base
from .result import Reconstruction
from .robust_weights import robust_weights, spread
from .tangent_planes import TangentPlanes
from .trimming import trimmed

CORRECTION_STEPS = 2
"""Steps towards the nearest point of the surface, between fits."""

FIRST_FIT_ENDS = 0.3
"""Share of a run with a tolerance after which the base is refined."""

NOISY, STRAY_LEVELS = 0.05, 5.0
"""With noise above this share of the spacing, points of a cloud with strays are left out of corrections where they are
farther from the surface than this many noise levels."""

COARSER = 2
"""The coarse fit that fills places without points has rings larger by this."""

ROBUST_ROUNDS = 2
ROBUST_ITERATIONS = 2
"""Coarse fits that find outliers, and the iterations of each."""

CREASE_WEIGHT = 1.0
"""Weight of an estimated crease point, beside that of a point of the cloud."""

SMALLEST_SCALE = 0.1
"""Robust weights use at least this share of the spacing as scale: a rounded crease is not an outlier."""


def reconstruct(
    points: ArrayLike,
    base_vertices: Any,
    base_faces: ArrayLike | Sequence[Sequence[int]] | None = None,
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
        A coarse mesh near the points: (V, 3), and (F, n) vertex numbers or a list of polygons; without faces a pair, a
        mesh of another library or a file, as in `approximate`.
    settings
        How patches are fitted; `Settings.ring` is ignored.  Towards a tolerance the base is refined.
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
    base = given_mesh(base_vertices, base_faces)
    return run_to_end(reconstruct_steps(points, base.vertices, base.faces, settings, cloud, executor=executor), report)


@on_one_thread
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
    cloud = cloud or CloudSettings()
    found = clean(points, keep_strays=cloud.strays == "keep")
    return (yield from reconstruct_clean(found, base_vertices, base_faces, settings, cloud, executor=executor))


@on_one_thread
def reconstruct_clean(
    points: CleanCloud,
    base_vertices: ArrayLike,
    base_faces: ArrayLike | Sequence[Sequence[int]],
    settings: Settings | None,
    cloud: CloudSettings,
    *,
    executor: Executor | None = None,
) -> Steps[Reconstruction]:
    """`reconstruct_steps` from points that were cleaned before."""
    settings = replace((settings or Settings()).resolved(), keep_iterations=False, denoise="off")
    base = checked_base(base_vertices, base_faces)
    refuse_distant(points.points, base)
    with chunk_runner(settings, len(points.points), executor) as runner:
        return (yield from noting_early_end(_Work(points, base, settings, cloud, runner).steps()))


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

    def __init__(
        self, clean: CleanCloud, base: TriangleMesh, settings: Settings, cloud: CloudSettings, runner: ChunkRunner
    ) -> None:
        self.clean, self.points = clean, clean.points
        self.base, self.settings, self.cloud, self.runner = base, settings, cloud, runner
        self.asked = settings
        self.watch = Stopwatch()
        self.weights = np.ones(len(self.points))
        self.hurry = False

    def steps(self) -> Steps[Reconstruction]:
        yield Progress("Looking at the points", 0.0)
        with self.watch.stage("cover"):
            self.geometry = self._geometry()
            self.planes = TangentPlanes(self.points, self.geometry)
        yield Progress("Fitting the base", 0.02)
        with self.watch.stage("cover"):
            self.mesh = trimmed(self._fitted_base(), self.points, self.geometry.spacing, self.cloud)
        sought = None
        fitted = yield from within(self._fitted(), 0.02, FIRST_FIT_ENDS if self.asked.tolerance else 0.95)
        if self.asked.tolerance:
            fitted, sought = yield from within(self._refined(fitted), FIRST_FIT_ENDS, 0.95)
        yield Progress("Measuring", 0.95)
        return measured(fitted, self.clean, self.geometry, self.cloud, self.watch, sought)

    def _refined(self, best: Fitted) -> Steps[tuple[Fitted, ToleranceSought]]:
        """Refine the base where points are outside the tolerance; the surface with the fewest of them is taken."""
        tolerance, noise = self.asked.tolerance, self.geometry.noise
        outside = best.outside(tolerance, noise)
        fewest = int(outside.sum())
        sought, newest, in_vain = ToleranceSought(tolerance, fewest, fewest), best, 0
        for number in range(ROUNDS):
            base = refined_base(newest, outside)
            if self.hurry or base is None:
                break
            with self.watch.stage("refine"):
                self.base = base
                self.mesh = self._fitted_base()
            newest = yield from within(self._fitted(), number / ROUNDS, (number + 1) / ROUNDS)
            outside = newest.outside(tolerance, noise)
            left = int(outside.sum())
            sought.rounds.append({"vertices": len(base.vertices), "points_outside": left})
            in_vain = in_vain + 1 if left > (1.0 - LEAST_GAIN) * sought.outside else 0
            if left < sought.outside:
                best, sought.outside = newest, left
            if in_vain == PATIENCE:
                break
        return best, sought

    def _fitted(self) -> Steps[Fitted]:
        """Fit patches over the base as it is, from the first cover to the last correction."""
        yield Progress("Choosing the patches", 0.0)
        with self.watch.stage("cover"):
            observed = self._observed()
            self.settings = self._adapted_settings(observed)
            observed = yield from within(self._filled(observed), 0.0, 0.02)
        with self.watch.stage("domains"):
            surface = self._covered(observed, self.settings, CLOSER if is_noisy(self.geometry) else 0)
        if not len(surface.patches):
            raise InputError("The base has no room for a patch: none of its triangles are connected.")
        if self.cloud.robust != "none":
            with self.watch.stage("solve"):
                surface.observations = yield from within(self._weighed(surface), 0.02, 0.05)
        test = partial(oscillating_in_cloud, planes=self.planes)
        with self.watch.stage("solve"):
            end = SOLVE_ENDS if self.settings.sweeps else 1.0
            self.hurry = yield from within(surface.fit(), 0.05, end)
            for _ in surface.refit_oscillating(test):
                pass
        iterations = measured_iterations(surface.fits)
        if not self.hurry:
            with self.watch.stage("sweeps"):
                yield from within(self._swept(surface, test), SOLVE_ENDS, 1.0)
        with self.watch.stage("measure"):
            return self._compared(surface, iterations)

    def _compared(self, surface: CloudSurface, iterations: dict[str, list[float]]) -> Fitted:
        """Keep the surface near the points, and find the place on it that is nearest to each."""
        feet, count = surface.observations.cloud.feet, len(self.points)
        start = Footpoints(feet.triangle[:count], feet.barycentric[:count])
        copied = kept_near(surface, self.planes)
        representation = surface.representation()
        on_surface = representation.evaluate(start.triangle, start.barycentric)
        parametric = np.linalg.norm(on_surface - self.points, axis=1)
        feet, distance = nearest_on_surface(representation, self.mesh, self.points, start, MEASURING_STEPS)
        return Fitted(surface, self.weights, feet, distance, parametric, iterations, copied)

    def _geometry(self) -> CloudGeometry:
        geometry = analyse(self.points, self.clean.outward)
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
        ring = self.cloud.ring or ring_for_noise(self.mesh, observed, self.geometry, self.asked, self.runner)
        reach = ring * float(np.linalg.norm(np.diff(self.mesh.vertices[self.mesh.edges], axis=1), axis=2).mean())
        iterations = iterations_for_noise(self.asked, self.geometry.noise / reach)
        sweeps = max(self.asked.sweeps, self.cloud.corrections)
        return replace(self.asked, ring=ring, iterations=iterations, sweeps=sweeps)

    def _covered(self, observed: ObservedCloud, settings: Settings, closer: int = 0) -> CloudSurface:
        patches = cover(self.mesh, settings.ring, self.runner.each, closer)
        patches, domains = with_domains(self.mesh, patches, settings, self.runner.each)
        observe = observer(self.mesh, settings, observed)
        return PatchedSurface(self.mesh, patches, domains, observe, settings, self.runner)

    def _filled(self, observed: ObservedCloud) -> Steps[ObservedCloud]:
        """Fill triangles with hardly any points from a coarse fit, whose larger patches reach those with more."""
        places = fillers(observed, self.mesh)
        if not len(places.triangle):
            return self._held(observed)
        on_base = filled(observed, places, places.on(self.mesh.vertices, self.mesh.triangles))
        settings = replace(self.settings, ring=self.settings.ring + COARSER, iterations=0, sweeps=0)
        coarse = self._covered(self._held(on_base), settings)
        yield from coarse.fit()
        on_surface = coarse.representation().evaluate(places.triangle, places.barycentric)
        flat = places.on(self.mesh.vertices, self.mesh.triangles)
        away = self.planes.run_away(on_surface, flat) > 0.0
        return self._held(filled(observed, places, np.where(away[:, None], flat, on_surface)))

    def _held(self, observed: ObservedCloud) -> ObservedCloud:
        return held_at_border(observed, self.mesh, self.planes, self.geometry.spacing)

    def _weighed(self, surface: CloudSurface) -> Steps[CloudObservations]:
        """Find outliers by a few coarse fits, so that they do not influence the choice of functions."""
        few = min(ROBUST_ITERATIONS, self.settings.iterations)
        coarse = self._covered(surface.observations.cloud, replace(self.settings, iterations=few, sweeps=0))
        for number in range(ROBUST_ROUNDS):
            yield from within(coarse.fit(), number / ROBUST_ROUNDS, (number + 1) / ROBUST_ROUNDS)
            cloud = coarse.observations.cloud
            on_surface = coarse.representation().evaluate(cloud.feet.triangle, cloud.feet.barycentric)
            away = np.linalg.norm(on_surface - cloud.points, axis=1)[: len(self.points)]
            coarse.observations = coarse.observations.of_cloud(self._weighted(cloud, away))
        return surface.observations.of_cloud(coarse.observations.cloud)

    def _weighted(self, observed: ObservedCloud, distance: Array) -> ObservedCloud:
        self.weights = self._robust(distance)
        return observed.moved(observed.feet, self.weights)

    def _robust(self, distance: Array) -> Array:
        scale = max(spread(distance), self.geometry.noise, SMALLEST_SCALE * self.geometry.spacing)
        if self.cloud.robust == "none":
            return np.where(distance > STRAY_LEVELS * scale, 0.0, 1.0)
        return robust_weights(distance, self.cloud.robust, scale)

    def _swept(self, surface: CloudSurface, test: OscillationTest[CloudObservations]) -> Steps[None]:
        """Correct the points' parameters, and refit every patch against what the others leave of the points."""
        rounds = self.settings.sweeps
        for number in range(rounds):
            cloud = surface.observations.cloud
            if number < self.cloud.corrections:
                cloud = self._corrected(surface)
            surface.observe(surface.observations.of_cloud(cloud))
            sweep = surface.sweep("Fitting again", f"round {number + 1} of {rounds}")
            finish = yield from within(sweep, number / rounds, (number + 1) / rounds)
            for _ in surface.refit_oscillating(test):
                pass
            if finish:
                break

    def _corrected(self, surface: CloudSurface) -> ObservedCloud:
        """Project the points on the surface itself, and weigh them; in wide noise without what it puts them off.

        On a base with a border both sides of a thin part may be one sheet, whose thickness then counts as noise.
        """
        cloud, representation = surface.observations.cloud, surface.representation()
        if self.geometry.noise > NOISIEST * self.geometry.spacing and self.mesh.edge_triangles.min() >= 0:
            whole = WholeSurface(representation, self.mesh, self.geometry.spacing)
            moved, distance = without_bias(cloud, self.points, whole, self.geometry.noise)
        else:
            feet, distance = nearest_on_surface(representation, self.mesh, cloud.points, cloud.feet, CORRECTION_STEPS)
            moved = cloud.moved(feet, cloud.weights)
        if self.cloud.robust == "none" and not self._has_hidden_strays():
            return moved
        return self._weighted(moved, distance[: len(self.points)])

    def _has_hidden_strays(self) -> bool:
        """Whether strays may lie among the points: in noise those near the surface do not stand out before a fit."""
        return bool(self.clean.strays.any()) and self.geometry.noise > NOISY * self.geometry.spacing

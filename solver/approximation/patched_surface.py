"""The surface under construction: patches over a mesh, what they are fitted to, and their fits so far."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any, Generic, TypeVar

import numpy as np

from ..arrays import Array, Booleans, Indices, offsets_of, slices_of, sum_of
from ..fitting.chunks import ChunkTask, PatchFit, chunk_patches, chunk_task, problems_of, values_at, with_values_at
from ..fitting.gathered import MeshTask, Remainder, Task, joined_values
from ..fitting.methods.variable_projection import EARLY_MISFIT
from ..mesh.triangle_mesh import TriangleMesh
from ..native.library import reason_for_numpy
from ..native.observations import Blend, Observed
from ..patch_methods import METHODS
from ..patches.blending import blending_weights, fitting_weights
from ..patches.cover import build_cover
from ..patches.observations import Observations, PatchObservations
from ..patches.parameterisation import initial_domains
from ..patches.patches import Patches, build_patches, overlay_patches
from ..patches.splitting import with_domains
from ..processes.each import Each, all_done
from ..processes.memory import give_back
from ..progress import FINISH, Progress, Steps
from ..settings import Settings
from ..surface.assembly import assemble
from ..surface.representation import Representation
from .preview import Preview
from .runner import ChunkRunner
from .sweeps import ANTI_DRIFT, CHUNKS_A_COLOUR, against_remainder, colour_patches

Observing = TypeVar("Observing", bound=Observations)

PATCHES_AT_ONCE = 64
"""Patches whose values are blended together: more would not fit into the cache."""


class PatchedSurface(Generic[Observing]):
    """K patches over a mesh: their domains, what they are fitted to, and their fits so far.

    Attributes
    ----------
    mesh
        The mesh that carries the patches.
    patches, domains, blending
        The cover, with initial domains (M, 2) in scene units and blending weights (M,).
    settings
        Resolved settings.
    runner
        What fits chunks of patches.
    preview
        Shows the surface at the mesh's vertices during `fit` and `sweep`; the observations must then begin with its
        nodes.  None: progress shows nothing.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        patches: Patches,
        domains: Array,
        observe: Callable[[Patches, Array], Observing],
        settings: Settings,
        runner: ChunkRunner,
        blending: Array | None = None,
    ) -> None:
        """Take patches with their domains.

        Parameters
        ----------
        observe
            Makes the observations of patches with given blending weights, (M,).
        blending
            Blending weights where more patches than these share the mesh; computed where None.
        """
        self.mesh, self.patches, self.domains = mesh, patches, domains
        self.settings, self.runner = settings, runner
        self.blending = blending_weights(mesh, patches, settings.blending) if blending is None else blending
        self.preview: Preview | None = None
        self._observe = observe
        self._observations: Observing | None = None
        self._fits: list[PatchFit | None] = [None] * len(patches)
        self._native: tuple[Observing, Observed | None] | None = None
        self._blended: Array | None = None
        self._order: Indices | None = None
        # the representation, where it is up to date, and what earlier ones of these patches have computed of the cover
        self._assembled: Representation | None = None
        self._cover: dict[str, Any] = {}

    @classmethod
    def covering(
        cls,
        mesh: TriangleMesh,
        observe: Callable[[Patches, Array], Observing],
        settings: Settings,
        runner: ChunkRunner,
    ) -> PatchedSurface[Observing]:
        """Cover a mesh with patches of `settings.ring` and map them to the plane."""
        patches, domains = with_domains(mesh, cover(mesh, settings.ring, runner.each), settings, runner.each)
        return cls(mesh, patches, domains, observe, settings, runner)

    @property
    def fits(self) -> list[PatchFit]:
        """The fits of the patches that have one, in the order of the patches."""
        return [fit for fit in self._fits if fit is not None]

    @property
    def observations(self) -> Observing:
        """What the patches are fitted to; assign to it before fitting them to something else."""
        if self._observations is None:
            self._observations = self._observe(self.patches, self.blending)
        return self._observations

    @observations.setter
    def observations(self, observations: Observing) -> None:
        self._observations, self._blended, self._order = observations, None, None

    def fit(self, *, hurry: bool = False) -> Steps[bool]:
        """Fit every patch by itself (eqs. 2-4).

        In a hurry, or once it is sent `FINISH`, it fits the patches that have not begun over their initial domains.

        Returns
        -------
        bool
            Whether there is a hurry now.
        """
        count = len(self.patches)
        self._fits, self._assembled, self._blended = [None] * count, None, None
        chunks = self._chunks(np.arange(count))
        self._order = np.concatenate([np.zeros(0, dtype=np.int64), *chunks])
        hurried = replace(self.settings, iterations=0)

        def tasks() -> Iterator[Task]:
            for chunk in chunks:
                yield self._task(chunk, hurried if hurry else self.settings)

        shown = self._shown()
        request = yield Progress("Solving patches", 0.0, f"0 of {count} patches", shown)
        hurry = hurry or request == FINISH
        done = 0
        for fitted in self._fitted(tasks()):
            done += fitted
            request = yield Progress("Solving patches", done / count, f"{done} of {count} patches", shown)
            hurry = hurry or request == FINISH
        self._blended = None  # summed in another order where somebody looked
        return hurry

    def refit(self, which: Indices, observations: Observing) -> Iterator[int]:
        """Fit some patches by themselves to other observations; yields how many each step has fitted."""
        self.observations = observations
        yield from self._fitted(self._task(chunk, self.settings) for chunk in self._chunks(which))

    def refit_oscillating(self, test: OscillationTest[Observing]) -> Iterator[int]:
        """Refit patches that oscillate between their observations; yields how many each step has fitted.

        Parameters
        ----------
        test
            Yields, once or more often, which patches oscillate, (K,), and the observations to fit them to.
        """
        for oscillating, observations in test(self):
            yield from self.refit(np.flatnonzero(oscillating), observations)

    def sweep(self, stage: str, detail: str) -> Steps[bool]:
        """Refit the patches once against what the others leave of the data (eq. 6); good sides of creases stay.

        Its progress has this stage and detail.  Sent `FINISH`, it stops at once.

        Returns
        -------
        bool
            Whether `FINISH` was sent.
        """
        shown, done, good = self._shown(), 0, self._are_good_sides()
        for colour in colour_patches(self.patches):
            swept = colour[~good[colour]]
            done += len(colour) - len(swept)
            tasks = (self._sweep_task(chunk) for chunk in self._chunks(swept, CHUNKS_A_COLOUR) if len(chunk))
            for fitted in self._fitted(tasks, swept=True):
                done += fitted
                request = yield Progress(stage, done / len(self.patches), detail, shown)
                if request == FINISH:
                    return True
        return False

    def lay_over(self, triangles: Booleans, ring: int, level: int, settings: Settings) -> Steps[Patches]:
        """Lay patches of a smaller ring over some triangles, (T,), and fit them; returns the new patches."""
        count, wanted = len(self.patches), np.zeros(len(self.mesh.vertices), dtype=bool)
        wanted[self.mesh.triangles[triangles]] = True
        patches = overlay_patches(self.mesh, self.patches, wanted, ring, level)
        blending = blending_weights(self.mesh, patches, settings.blending)
        new = patches.select(np.arange(count, len(patches)))
        domains = initial_domains(self.mesh, new, settings.initial_domain, self.runner.each)
        own = blending[patches.vertex_offsets[count] :]
        layer = PatchedSurface(self.mesh, new, domains, self._observe, settings, self.runner, own)
        done = 0
        for fitted in layer.refit(np.arange(len(new)), layer.observations):
            done += fitted
            yield Progress("Keeping the tolerance", done / len(new), f"{done} of {len(new)} finer patches")
        self._change(patches, np.concatenate([self.domains, domains]), self.fits + layer.fits, blending)
        return new

    def pass_through(self, vertices: Booleans) -> None:
        """Let the surface be the input itself at some vertices, (V,)."""
        self._change(self.patches.passing(vertices), self.domains, self.fits)

    def select(self, which: Indices) -> None:
        """Keep only some patches, in ascending order."""
        kept = np.isin(self.patches.vertex_patch, which)
        fits = self.fits
        self._change(self.patches.select(which), self.domains[kept], [fits[k] for k in which])

    def observe(self, observations: Observing) -> None:
        """Change what is observed, and evaluate the fits there; the fits themselves stay."""
        each = enumerate(self.fits)
        self.restore([with_values_at(fit, observations.of_patch(k), self.settings) for k, fit in each], observations)

    def restore(self, fits: list[PatchFit], observations: Observing) -> None:
        """Take earlier fits of all patches, evaluated where these have been observed more densely since then."""
        self.observations = observations
        changed = [k for k, (fit, own) in enumerate(zip(fits, self._fits, strict=True)) if fit is not own]
        if changed:
            self._outdate()
            self._fits = list(fits)
        for k in changed:
            if len(fits[k].values) != len(observations.blend_of(k)[0]):
                self._fits[k] = with_values_at(fits[k], observations.of_patch(k), self.settings)

    def values_at(self, patch: int, observations: PatchObservations) -> Array:
        """A fitted patch's own surface at observations of its triangles, (N, 3), scene units."""
        fit = self._fits[patch]
        assert fit is not None
        return values_at(fit, observations, self.settings)

    def representation(self) -> Representation:
        """Return what evaluates the surface in its present state; every patch must be fitted."""
        if self._assembled is None:
            self._assembled = assemble(self.mesh, self.patches, self.blending, self.fits, self.settings)
            self._assembled.take_cover(self._cover)
        return self._assembled

    def _outdate(self) -> None:
        """Forget the representation, but not what it has computed of the cover."""
        if self._assembled is not None:
            self._cover, self._assembled = self._assembled.computed_cover(), None

    def forget_observations(self) -> None:
        """Free what only fitting needs: bounding and measuring take memory, too."""
        self._fits = [None if fit is None else fit.without_values() for fit in self._fits]
        self._forget_data()

    def forget_fits(self) -> None:
        """Free what only assembling a representation needs."""
        self._fits = [None] * len(self.patches)
        self._forget_data()

    def _forget_data(self) -> None:
        self._observations = self._native = self._blended = self._order = self.preview = None
        give_back(len(self.mesh.vertices))

    @property
    def blended(self) -> Array:
        """The blend of the patches at the observations, (O, 3): the data where patches are missing.

        It is summed in the order in which the patches were fitted together, before changes one by one.
        """
        if self._blended is None:
            self._blended = self.observations.points.copy()
            order = np.arange(len(self.patches)) if self._order is None else self._order
            fitted = np.array([k for k in order if self._fits[k] is not None], dtype=np.int64)
            for first in range(0, len(fitted), PATCHES_AT_ONCE):
                own = fitted[first : first + PATCHES_AT_ONCE]
                self._exchange(own, None, [fit for k in own if (fit := self._fits[k]) is not None])
        return self._blended

    def blends(self, patches: Indices) -> tuple[Indices, Array]:
        """Observations of some patches, one after the other, and the patches' blending weights there, (N,) both."""
        if self._observed is not None:
            return self._observed.blends(patches)[1:]
        each = [self.observations.blend_of(int(patch)) for patch in patches]
        number, blending = (np.concatenate(own) for own in zip(*each, strict=True))
        return number, blending

    @property
    def _observed(self) -> Observed | None:
        """What the compiled kernel gathers from; None where NumPy does it."""
        if self._native is None or self._native[0] is not self.observations:
            natively = reason_for_numpy(self.settings) is None
            self._native = self.observations, self.observations.natively(self.domains) if natively else None
        return self._native[1]

    def _exchange(self, patches: Indices, before: list[PatchFit] | None, after: list[PatchFit]) -> None:
        """Replace the part that patches have in the blend; without earlier fits that part is the data."""
        blended, points = self.blended, self.observations.points
        if self._observed is not None:
            earlier = None if before is None else joined_values(before)
            Blend(points, blended).exchange(self._observed.blends(patches), earlier, joined_values(after))
            return
        for k, patch in enumerate(patches):
            number, blending = self.observations.blend_of(int(patch))
            values = points[number] if before is None else before[k].values
            blended[number] += blending[:, None] * (after[k].values - values)

    def _chunks(self, which: Indices, pieces: int = 1) -> list[Indices]:
        return chunk_patches(self.observations, which, self.settings.channels, pieces)

    def _task(self, chunk: Indices, settings: Settings) -> Task:
        """Some patches by themselves."""
        if self._observed is None:
            return chunk_task(self.observations, self.domains, settings, chunk)
        return self._mesh_task(self._observed, chunk, settings)

    def _mesh_task(
        self, observed: Observed, chunk: Indices, settings: Settings, remainder: Remainder | None = None
    ) -> MeshTask:
        degrees = np.minimum(settings.degree, self.observations.allowed_degrees(chunk))
        return MeshTask(chunk, observed, degrees, self.observations.ends_early[chunk], settings, remainder)

    def _fitted(self, tasks: Iterable[Task], swept: bool = False) -> Iterator[int]:
        """Fit chunks and take their fits; yields how many each step has fitted."""
        for task, fits in self.runner.run(tasks):
            before = self._fits_of(task.patches)
            if self._blended is not None:
                self._exchange(task.patches, before or None, fits)
            taken = fits if not before or not swept else map(PatchFit.with_iterations_of, fits, before)
            for patch, fit in zip(map(int, task.patches), taken, strict=True):
                self._fits[patch] = fit
            self._outdate()
            yield len(fits)

    def _fits_of(self, patches: Indices) -> list[PatchFit]:
        """The fits of some patches; an empty list where they have none yet."""
        fits = [fit for k in patches if (fit := self._fits[k]) is not None]
        assert len(fits) in (0, len(patches))
        return fits

    def _are_good_sides(self) -> Booleans:
        """Which patches lie at a crease and fit so well that nothing is left to be made consistent, (K,)."""
        good, observed = self.observations.ends_early.copy(), self._observed
        early = np.flatnonzero(good)

        def judge(part: slice) -> None:
            good[early[part]] = self._misfits(early[part], observed) < EARLY_MISFIT**2

        all_done(self.runner.each, judge, slices_of(len(early), PATCHES_AT_ONCE))
        return good

    def _misfits(self, patches: Indices, observed: Observed | None) -> Array:
        """Weighted mean square of the patches' distances from the data, in their frames, (n,)."""
        fits = self._fits_of(patches)
        scale = np.array([max(frame.scale for frame in fit.frames) for fit in fits])
        offsets = offsets_of(np.array([len(fit.values) for fit in fits], dtype=np.int64))[:-1]
        if observed is not None:
            given = observed.gather(patches, fitting=True)
            points, weights = given.values, given.weights
        else:
            each = [self.observations.of_patch(int(patch)) for patch in patches]
            points = self.observations.points[np.concatenate([one.number for one in each])]
            kind = self.settings.blending
            weights = np.concatenate([fitting_weights(one.blending, one.weights, kind) for one in each])
        squares, total = weights * sum_of((joined_values(fits) - points) ** 2), np.add.reduceat(weights, offsets)
        return np.add.reduceat(squares, offsets) * scale**2 / np.where(total > 0.0, total, 1.0)

    def _sweep_task(self, chunk: Indices) -> Task:
        """Problems of some patches against what all the others leave, started from their fits."""
        fits, points = self._fits_of(chunk), self.observations.points
        if self._observed is not None:
            remainder = Remainder(fits, Blend(points, self.blended), ANTI_DRIFT)
            return self._mesh_task(self._observed, chunk, self.settings, remainder)
        problems = []
        for k, fit in zip(map(int, chunk), fits, strict=True):
            own = self.observations.of_patch(k)
            alone = problems_of(self.observations, own, self.domains, self.settings, k)
            left = points[own.number] - self.blended[own.number] + own.blending[:, None] * fit.values
            problems += against_remainder(alone, own, left, fit, METHODS[self.settings.method].keeps_balance)
        return ChunkTask(chunk, problems, self.settings)

    def _change(self, patches: Patches, domains: Array, fits: list[PatchFit], blending: Array | None = None) -> None:
        """Take other patches over the same mesh."""
        self.patches, self.domains, self._fits = patches, domains, list(fits)
        self.blending = blending_weights(self.mesh, patches, self.settings.blending) if blending is None else blending
        self._observations = self._blended = self._assembled = self._native = self._order = None
        self._cover = {}

    def _shown(self) -> Callable[[], Array] | None:
        if (preview := self.preview) is None:
            return None
        return lambda: preview.surface(self.blended, [fit is not None for fit in self._fits])


OscillationTest = Callable[[PatchedSurface[Observing]], Iterator[tuple[Booleans, Observing]]]
"""Finds the patches that oscillate between their observations, and what to fit them to (see `refit_oscillating`)."""


def cover(mesh: TriangleMesh, ring: int, each: Each = map, closer: int = 0) -> Patches:
    """Cover a mesh with patches of this ring, as few as can be or so many that rings smaller by `closer` would do."""
    return build_patches(mesh, build_cover(mesh, max(ring - closer, 1)), ring, each=each)

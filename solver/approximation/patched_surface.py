"""The surface under construction: patches over a mesh, what they are fitted to, and their fits so far."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Generic, TypeVar

import numpy as np

from ..arrays import Array, Booleans, Indices
from ..fitting.chunks import ChunkTask, PatchFit, chunk_patches, chunk_task, problems_of, values_at
from ..fitting.methods.variable_projection import EARLY_MISFIT
from ..mesh.triangle_mesh import TriangleMesh
from ..patch_methods import METHODS
from ..patches.blending import blending_weights, fitting_weights
from ..patches.cover import build_cover
from ..patches.observations import Observations, PatchObservations
from ..patches.parameterisation import initial_domains
from ..patches.patches import Patches, build_patches, overlay_patches
from ..patches.splitting import with_domains
from ..progress import FINISH, Progress, Steps
from ..settings import Settings
from ..surface.assembly import assemble
from ..surface.representation import Representation
from .preview import Preview
from .runner import ChunkRunner
from .sweeps import CHUNKS_A_COLOUR, against_remainder, colour_patches

Observed = TypeVar("Observed", bound=Observations)


class PatchedSurface(Generic[Observed]):
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
        observe: Callable[[Patches, Array], Observed],
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
        self._observations: Observed | None = None
        self._fits: list[PatchFit | None] = [None] * len(patches)
        self._blended: Array | None = None
        # the representation, where it is up to date, and the last one of these patches
        self._assembled: Representation | None = None
        self._earlier: Representation | None = None

    @classmethod
    def covering(
        cls,
        mesh: TriangleMesh,
        observe: Callable[[Patches, Array], Observed],
        settings: Settings,
        runner: ChunkRunner,
    ) -> PatchedSurface[Observed]:
        """Cover a mesh with patches of `settings.ring` and map them to the plane."""
        return cls(mesh, *with_domains(mesh, cover(mesh, settings.ring), settings), observe, settings, runner)

    @property
    def fits(self) -> list[PatchFit]:
        """The fits of the patches that have one, in the order of the patches."""
        return [fit for fit in self._fits if fit is not None]

    @property
    def observations(self) -> Observed:
        """What the patches are fitted to; assign to it before fitting them to something else."""
        if self._observations is None:
            self._observations = self._observe(self.patches, self.blending)
        return self._observations

    @observations.setter
    def observations(self, observations: Observed) -> None:
        self._observations, self._blended = observations, None

    def fit(self, *, hurry: bool = False) -> Steps[bool]:
        """Fit every patch by itself (eqs. 2-4).

        In a hurry, or once it is sent `FINISH`, it fits the patches that have not begun over their initial domains.

        Returns
        -------
        bool
            Whether there is a hurry now.
        """
        count = len(self.patches)
        self._fits, self._assembled = [None] * count, None
        self._blended = self.observations.points.copy()
        hurried = replace(self.settings, iterations=0)

        def tasks() -> Iterator[ChunkTask]:
            for chunk in self._chunks(np.arange(count)):
                yield chunk_task(self.observations, self.domains, hurried if hurry else self.settings, chunk)

        shown = self._shown()
        request = yield Progress("Solving patches", 0.0, f"0 of {count} patches", shown)
        hurry = hurry or request == FINISH
        done = 0
        for fitted in self._fitted(tasks()):
            done += fitted
            request = yield Progress("Solving patches", done / count, f"{done} of {count} patches", shown)
            hurry = hurry or request == FINISH
        return hurry

    def refit(self, which: Indices, observations: Observed) -> Iterator[int]:
        """Fit some patches by themselves to other observations; yields how many each step has fitted."""
        self.observations = observations
        tasks = (chunk_task(observations, self.domains, self.settings, chunk) for chunk in self._chunks(which))
        yield from self._fitted(tasks)

    def refit_oscillating(self, test: OscillationTest[Observed]) -> Iterator[int]:
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
        shown, done = self._shown(), 0
        for colour in colour_patches(self.patches):
            swept = np.array([k for k in colour if not self._is_good_side(int(k))], dtype=np.int64)
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
        domains = initial_domains(self.mesh, new, settings.initial_domain)
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

    def observe(self, observations: Observed) -> None:
        """Change what is observed, and evaluate the fits there; the fits themselves stay."""
        self.restore(
            [replace(fit, values=self.values_at(k, observations.of_patch(k))) for k, fit in enumerate(self.fits)],
            observations,
        )

    def restore(self, fits: list[PatchFit], observations: Observed) -> None:
        """Take earlier fits of all patches, and the observations that they were fitted to."""
        self.observations = observations
        self._fits, self._assembled = list(fits), None

    def values_at(self, patch: int, observations: PatchObservations) -> Array:
        """A fitted patch's own surface at observations of its triangles, (N, 3), scene units."""
        fit = self._fits[patch]
        assert fit is not None
        return values_at(fit, observations, self.settings)

    def representation(self) -> Representation:
        """Return what evaluates the surface in its present state; every patch must be fitted."""
        if self._assembled is None:
            self._assembled = assemble(self.mesh, self.patches, self.blending, self.fits, self.settings)
            if self._earlier is not None:
                self._assembled.share_cover_of(self._earlier)
            self._earlier = self._assembled
        return self._assembled

    @property
    def blended(self) -> Array:
        """The blend of the patches at the observations, (O, 3): the data where patches are missing.

        Patches change it in the order in which they are fitted.
        """
        if self._blended is None:
            self._blended = self.observations.points.copy()
            for patch, fit in enumerate(self._fits):
                if fit is not None:
                    self._exchange(self._blended, patch, None, fit)
        return self._blended

    def _exchange(self, blended: Array, patch: int, before: PatchFit | None, after: PatchFit) -> None:
        """Replace a patch's part of the blend; without an earlier fit that part is the data."""
        number, blending = self.observations.blend_of(patch)
        values = self.observations.points[number] if before is None else before.values
        blended[number] += blending[:, None] * (after.values - values)

    def _chunks(self, which: Indices, pieces: int = 1) -> list[Indices]:
        return chunk_patches(self.observations, which, self.settings.channels, pieces)

    def _fitted(self, tasks: Iterable[ChunkTask], swept: bool = False) -> Iterator[int]:
        """Fit chunks and take their fits; yields how many each step has fitted."""
        for task, fits in self.runner.run(tasks):
            for patch, fit in zip(map(int, task.patches), fits, strict=True):
                before = self._fits[patch]
                if self._blended is not None:
                    self._exchange(self._blended, patch, before, fit)
                self._fits[patch] = fit if before is None or not swept else _with_iterations_of(fit, before)
            self._assembled = None
            yield len(fits)

    def _is_good_side(self, patch: int) -> bool:
        """Whether a patch lies at a crease and fits so well that nothing is left to be made consistent."""
        if not self.observations.ends_early[patch]:
            return False
        fit, own = self._fits[patch], self.observations.of_patch(patch)
        assert fit is not None
        weights = fitting_weights(own.blending, own.weights, self.settings.blending)
        squares = ((fit.values - self.observations.points[own.number]) ** 2).sum(axis=1)
        scale = max(frame.scale for frame in fit.frames)
        return bool((weights * squares).sum() * scale**2 < EARLY_MISFIT**2 * weights.sum())

    def _sweep_task(self, chunk: Indices) -> ChunkTask:
        """Problems of some patches against what all the others leave, started from their fits."""
        problems = []
        for k in map(int, chunk):
            fit, own = self._fits[k], self.observations.of_patch(k)
            assert fit is not None
            alone = problems_of(self.observations, own, self.domains, self.settings, k)
            left = self.observations.points[own.number] - self.blended[own.number]
            left += own.blending[:, None] * fit.values
            problems += against_remainder(alone, own, left, fit, METHODS[self.settings.method].keeps_balance)
        return ChunkTask(chunk, problems, self.settings)

    def _change(self, patches: Patches, domains: Array, fits: list[PatchFit], blending: Array | None = None) -> None:
        """Take other patches over the same mesh."""
        self.patches, self.domains, self._fits = patches, domains, list(fits)
        self.blending = blending_weights(self.mesh, patches, self.settings.blending) if blending is None else blending
        self._observations = self._blended = self._assembled = self._earlier = None

    def _shown(self) -> Callable[[], Array] | None:
        if self.preview is None:
            return None
        preview = self.preview
        return lambda: preview.surface(self.blended, [fit is not None for fit in self._fits])


OscillationTest = Callable[[PatchedSurface[Observed]], Iterator[tuple[Booleans, Observed]]]
"""Finds the patches that oscillate between their observations, and what to fit them to (see `refit_oscillating`)."""


def _with_iterations_of(fit: PatchFit, before: PatchFit) -> PatchFit:
    """A sweep minimises eq. 6, so the history stays that of the patch by itself (eq. 3)."""
    return replace(fit, energy=before.energy, squared_error=before.squared_error, history=before.history)


def cover(mesh: TriangleMesh, ring: int) -> Patches:
    """Cover a mesh with patches of this ring."""
    return build_patches(mesh, build_cover(mesh, ring), ring)

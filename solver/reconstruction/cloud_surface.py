"""Patches over a base mesh, fitted to an observed cloud: the surface while it is worked on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..approximation.approximate import solve_patches, sweep_patches
from ..approximation.runner import Crew
from ..approximation.sweeps import Blend
from ..fitting.chunks import PatchFit, chunk_patches, chunk_task, values_at
from ..mesh.triangle_mesh import TriangleMesh
from ..patches.blending import blending_weights
from ..patches.cover import build_cover
from ..patches.patches import build_patches
from ..patches.splitting import with_domains
from ..progress import Steps
from ..settings import Settings
from ..surface.assembly import assemble
from ..surface.representation import Representation
from .observations import CloudObservations, ObservedCloud
from .oscillation import LOWEST_DEGREE, SAMPLES, Planes, farthest, tamed

Array = NDArray[np.float64]

TAMING_ROUNDS = 3


class CloudSurface:
    """A surface over a base.

    Attributes
    ----------
    mesh
        The base.
    settings
        Resolved settings; `Settings.ring` in edges of the base.
    patches, domains, blending
        The cover, with initial domains (M, 2) and blending weights (M,).
    observations
        What the patches are fitted to.
    fits
        What each patch has; none before `solve`.
    """

    def __init__(self, mesh: TriangleMesh, observed: ObservedCloud, settings: Settings, crew: Crew) -> None:
        self.mesh, self.settings, self._crew = mesh, settings, crew
        patches = build_patches(mesh, build_cover(mesh, settings.ring), settings.ring)
        self.patches, self.domains = with_domains(mesh, patches, settings)
        self.blending = blending_weights(mesh, self.patches, settings.blending)
        self.fits: list[PatchFit] = []
        self.observations = self._observations(observed)

    @property
    def observed(self) -> ObservedCloud:
        """The observed points."""
        return self.observations.cloud

    def _observations(self, observed: ObservedCloud, degrees: NDArray[np.int64] | None = None) -> CloudObservations:
        return CloudObservations(self.mesh, self.patches, self.blending, self.settings.blending, observed, degrees)

    def observe(self, observed: ObservedCloud) -> None:
        """Change places and weights of the observed points; the patches stay as they are."""
        self.observations = self._observations(observed, self.observations.degrees)

    def solve(self) -> Steps[bool]:
        """Fit every patch by itself; returns whether that was hurried on request."""
        surface = Blend(self.observations)
        self.fits, hurry = yield from solve_patches(surface, self.domains, self.settings, self._crew)
        return hurry

    def sweep(self) -> Steps[None]:
        """Fit every patch once more, against what the others leave."""
        single = replace(self.settings, sweeps=1)
        yield from sweep_patches(self._blend(), self.domains, self.fits, single, self._crew)

    def _blend(self) -> Blend:
        """The surface of the fits at the observations as they are now."""
        self.fits = [
            replace(fit, values=values_at(fit, self.observations.of_patch(k), self.settings))
            for k, fit in enumerate(self.fits)
        ]
        surface = Blend(self.observations)
        for k, fit in enumerate(self.fits):
            surface.add(k, fit)
        return surface

    def tame(self, planes: Planes) -> int:
        """Fit patches that run away between the points anew, with lower degrees, and keep the tamest of each; returns
        how many are other ones than before.
        """
        before, degrees = self.fits, self.observations.degrees
        nearest = away = farthest(np.arange(len(before)), planes, self._sampled)
        best, best_degrees = list(before), degrees
        for _ in range(TAMING_ROUNDS):
            wild = (away > planes.tolerance) & (degrees > LOWEST_DEGREE)
            if not wild.any():
                break
            degrees = np.where(wild, tamed(degrees), degrees)
            self._fit_again(np.flatnonzero(wild), degrees)
            away = away.copy()
            away[wild] = farthest(np.flatnonzero(wild), planes, self._sampled)
            better = away < nearest
            nearest, best_degrees = np.where(better, away, nearest), np.where(better, degrees, best_degrees)
            best = [new if other else old for old, new, other in zip(best, self.fits, better, strict=True)]
        self.fits, self.observations = best, self._observations(self.observed, best_degrees)
        return sum(new is not old for old, new in zip(before, best, strict=True))

    def _fit_again(self, patches: NDArray[np.int64], degrees: NDArray[np.int64]) -> None:
        """Fit some patches by themselves, with other degrees (K,)."""
        self.fits = list(self.fits)
        self.observations = self._observations(self.observed, degrees)
        chunks = chunk_patches(self.observations, patches, self.settings.channels)
        tasks = (chunk_task(self.observations, self.domains, self.settings, chunk) for chunk in chunks)
        for task, fitted in self._crew.run(tasks):
            for patch, fit in zip(task.patches, fitted, strict=True):
                self.fits[patch] = fit

    def _sampled(self, patch: int) -> tuple[Array, Array]:
        samples = self.observations.samples_of_patch(patch, SAMPLES)
        return values_at(self.fits[patch], samples, self.settings), samples.blending

    def representation(self) -> Representation:
        """What evaluates the surface as it stands."""
        return assemble(self.mesh, self.patches, self.blending, self.fits, self.settings)

"""Chunks of a mesh's patches whose problems the compiled kernel gathers where it fits them.

Python takes longer to gather a patch's arrays than the kernel takes for a step of its fit, and holds its lock all the
while.  So what is handed on are the numbers of the patches, and the arrays of the whole mesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from ..arrays import Array, Booleans, Indices, offsets_of
from ..native.observations import Blend, Gathered, Observed
from ..settings import Settings
from .batch import Problem, WarmStart
from .chunks import ChunkTask, PatchFit


@dataclass(frozen=True)
class Remainder:
    """What a sweep fits patches to: what the others leave of the data.

    Attributes
    ----------
    fits
        The patches' fits so far.
    blend
        The blend of all patches.  Until the task is done, nothing else may change it where these patches lie.
    anti_drift
        Weight of the data itself (see `approximation.sweeps`).
    """

    fits: list[PatchFit]
    blend: Blend
    anti_drift: float


@dataclass(frozen=True)
class MeshTask:
    """All that a thread of this process needs to fit n patches of a mesh; `in_full` is what another process needs.

    Attributes
    ----------
    patches
        Numbers of the patches, (n,).
    observed
        Arrays of the whole mesh.
    degrees, ends_early
        Of each patch's problem, (n,).
    settings
        Resolved settings.
    remainder
        What a sweep fits them to; None: the data.
    """

    patches: Indices
    observed: Observed
    degrees: Indices
    ends_early: Booleans
    settings: Settings
    remainder: Remainder | None = None

    @property
    def warm(self) -> list[WarmStart | None]:
        """Earlier solutions from which to start: of the first domains of all patches, (n,), then of the next ones."""
        channels = self.settings.channels
        if self.remainder is None:
            return [None] * (len(self.patches) * channels)
        fits, each = self.remainder.fits, 3 // channels
        parts = [(c, slice(each * c, each * (c + 1))) for c in range(channels)]
        return [WarmStart(fit.frames[c], fit.domain[c], fit.support[part]) for c, part in parts for fit in fits]

    def gathered(self) -> Gathered:
        """The patches' problems, one after the other."""
        if self.remainder is None:
            return self.observed.gather(self.patches, fitting=True)
        given = self.observed.gather(self.patches, fitting=False)
        fitted = joined_values(self.remainder.fits)
        self.remainder.blend.take_remainder(given, fitted, self.remainder.anti_drift)
        return given

    def in_full(self) -> ChunkTask:
        """The same task with its problems."""
        given, warm, count = self.gathered(), self.warm, len(self.patches)
        vertices, faces = (offsets_of(own).tolist() for own in (given.vertices, given.triangle_count))
        observations, each = given.blends.offsets.tolist(), 3 // self.settings.channels
        problems = []
        for k, c in product(range(count), range(self.settings.channels)):
            m, t, n = (slice(*own[k : k + 2]) for own in (vertices, faces, observations))
            part = slice(each * c, each * (c + 1))
            own = Problem(
                given.domain[m],
                given.triangles[t],
                given.signals[m, part],
                given.corners[n],
                given.shares[n],
                given.values[n, part],
                given.weights[n],
                int(self.degrees[k]),
                ends_early=bool(self.ends_early[k]),
                warm=warm[c * count + k],
            )
            problems.append(own)
        return ChunkTask(self.patches, problems, self.settings)


Task = ChunkTask | MeshTask
"""Patches to be fitted together."""


def joined_values(fits: list[PatchFit]) -> Array:
    """The surfaces of patches at their observations, one after the other, (N, 3)."""
    return np.concatenate([np.zeros((0, 3)), *(fit.values for fit in fits)])

"""Consistent approximation of the whole surface: Gauss-Seidel sweeps over the patches (section 4.2, eq. 6).

The surface at a point is the blend of its patches, so each patch is re-fitted in turn against what the others leave of the data,
with everything else held.  Patches that share no vertex do not see each other; they have one colour and are re-fitted together.
Eq. 6 constrains only the blend, so overlapping patches could drift apart in opposite directions: a term gamma |b - h_k|^2 holds
each of them near the data.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .batch import Problem, WarmStart
from .mesh import TriangleMesh
from .patch_fit import ChunkTask, PatchFit, chunk_patches, patch_problems
from .patches import Patches
from .settings import Settings

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

ANTI_DRIFT = 0.1
"""gamma: weight that holds a patch near the data itself, beside the weight of what the others leave."""


class Blend:
    """The blended surface at vertices and triangle centroids, kept up to date while patches change."""

    def __init__(self, mesh: TriangleMesh, patches: Patches, weights: Array, kind: str) -> None:
        self.mesh, self.patches = mesh, patches
        self.vertex_weights = weights
        self.centroid_weights = centroid_blending_weights(mesh, patches, weights, kind)
        self.centroids = mesh.vertices[mesh.triangles].mean(axis=1)
        covered = np.bincount(patches.vertices, weights=weights, minlength=len(mesh.vertices))
        self._at_vertices = (1.0 - covered)[:, None] * mesh.vertices
        covered = np.bincount(patches.mesh_triangles, weights=self.centroid_weights, minlength=len(mesh.triangles))
        self._at_centroids = (1.0 - covered)[:, None] * self.centroids
        self._missing = np.bincount(patches.vertices, weights=weights, minlength=len(mesh.vertices))

    def add(self, patch: int, fit: PatchFit, sign: float = 1.0) -> None:
        """Add a patch's part to the surface, or take it away with sign -1."""
        at_vertices, at_triangles = self.parts(patch)
        self._missing[self.patches.vertices[at_vertices]] -= sign * self.vertex_weights[at_vertices]
        self._at_vertices[self.patches.vertices[at_vertices]] += (
            sign * self.vertex_weights[at_vertices, None] * fit.values
        )
        self._at_centroids[self.patches.mesh_triangles[at_triangles]] += (
            sign * self.centroid_weights[at_triangles, None] * fit.centroid_values
        )

    def parts(self, patch: int) -> tuple[slice, slice]:
        """Where a patch's vertices and triangles stand in the ragged arrays."""
        offsets, faces = self.patches.vertex_offsets, self.patches.triangle_offsets
        return slice(offsets[patch], offsets[patch + 1]), slice(faces[patch], faces[patch + 1])

    def preview(self) -> Array:
        """The surface at the input's vertices while patches come in, (V, 3): blended where they are there."""
        return self._at_vertices + self._missing[:, None] * self.mesh.vertices

    def remainder(self, patch: int, fit: PatchFit) -> tuple[Array, Array]:
        """What the other patches leave for this one, phi_k times its target, at vertices (m, 3) and centroids (t, 3)."""
        at_vertices, at_triangles = self.parts(patch)
        vertices = self.patches.vertices[at_vertices]
        triangles = self.patches.mesh_triangles[at_triangles]
        left = self.mesh.vertices[vertices] - self._at_vertices[vertices]
        left_inside = self.centroids[triangles] - self._at_centroids[triangles]
        left += self.vertex_weights[at_vertices, None] * fit.values
        left_inside += self.centroid_weights[at_triangles, None] * fit.centroid_values
        return left, left_inside


def centroid_blending_weights(mesh: TriangleMesh, patches: Patches, weights: Array, kind: str) -> Array:
    """Blending weight of each patch at the centroids of its triangles, (S,)."""
    if kind == "uniform":
        count = np.bincount(patches.mesh_triangles, minlength=len(mesh.triangles))
        return 1.0 / count[patches.mesh_triangles]
    first = np.repeat(patches.vertex_offsets[:-1], np.diff(patches.triangle_offsets))
    mean: Array = weights[patches.triangles + first[:, None]].mean(axis=1)
    return mean


def colour_patches(patches: Patches, vertex_count: int) -> list[Indices]:
    """Split the patches into sets in which no two share a vertex; first fit in the order of the patches."""
    count = len(patches.centres)
    rows = np.repeat(np.arange(count), np.diff(patches.vertex_offsets))
    holds = sp.csr_matrix((np.ones(len(rows)), (rows, patches.vertices)), shape=(count, vertex_count))
    touching = (holds @ holds.T).tocsr()
    colour = np.full(count, -1)
    for k in range(count):
        taken = colour[touching.indices[touching.indptr[k] : touching.indptr[k + 1]]]
        free = np.ones(len(taken) + 1, dtype=bool)
        free[taken[(taken >= 0) & (taken < len(free))]] = False
        colour[k] = int(np.argmax(free))
    return [np.flatnonzero(colour == c) for c in range(colour.max(initial=-1) + 1)]


def sweep(
    blend: Blend,
    domains: Array,
    fits: list[PatchFit],
    settings: Settings,
    run: Callable[[Iterable[ChunkTask]], Iterator[tuple[ChunkTask, list[PatchFit]]]],
) -> Iterator[int]:
    """One Gauss-Seidel pass over all patches; changes `fits` and `blend`, yields how many patches a step re-fitted.

    Parameters
    ----------
    blend
        The surface of `fits`.
    domains
        Initial domains in scene units, (M, 2).
    fits
        What each patch has; replaced where the patch's own objective fell.
    settings
        Resolved settings.
    run
        Fits chunks, in order.
    """
    channels = 3 if settings.domains == "separate" else 1
    for colour in colour_patches(blend.patches, len(blend.mesh.vertices)):
        chunks = chunk_patches(blend.patches, colour, channels)
        tasks = (sweep_task(blend, domains, fits, settings, chunk) for chunk in chunks)
        for task, fitted in run(tasks):
            for patch, fit in zip(task.patches, fitted, strict=True):
                blend.add(int(patch), fits[patch], -1.0)
                blend.add(int(patch), fit)
                fits[patch] = fit
            yield len(fitted)


def sweep_task(blend: Blend, domains: Array, fits: list[PatchFit], settings: Settings, chunk: Indices) -> ChunkTask:
    """Problems of some patches against what all the others leave, started from where they stand."""
    problems = []
    for k in map(int, chunk):
        own = patch_problems(blend.mesh, blend.patches, domains, blend.vertex_weights, settings, k)
        problems += _against_remainder(blend, own, fits[k], k)
    return ChunkTask(chunk, problems, settings)


def _against_remainder(blend: Blend, problems: list[Problem], fit: PatchFit, patch: int) -> list[Problem]:
    at_vertices, at_triangles = blend.parts(patch)
    left, left_inside = blend.remainder(patch, fit)
    phi, phi_inside = blend.vertex_weights[at_vertices], blend.centroid_weights[at_triangles]
    signals = np.cumsum([0] + [problem.values.shape[1] for problem in problems])
    result = []
    for c, problem in enumerate(problems):
        part = slice(signals[c], signals[c + 1])
        centroid_share = problem.centroid_weights.sum() / max(problem.vertex_weights.sum(), 1e-300)
        weights, values = _combined(phi, left[:, part], problem.values)
        inside, inside_values = _combined(phi_inside, left_inside[:, part], problem.centroid_values)
        inside *= centroid_share * weights.sum() / max(inside.sum(), 1e-300)
        scale = (problem.vertex_weights.sum() + problem.centroid_weights.sum()) / (weights.sum() + inside.sum())
        warm = WarmStart(fit.frames[c], fit.domain[c], fit.support[part])
        result.append(
            Problem(
                problem.domain,
                problem.triangles,
                values,
                inside_values,
                weights * scale,
                inside * scale,
                problem.degree,
                warm,
            )
        )
    return result


def _combined(phi: Array, left: Array, data: Array) -> tuple[Array, Array]:
    """Weights and targets whose least squares are phi^2 |left / phi - h|^2 + gamma |data - h|^2, up to a constant."""
    weight = phi**2 + ANTI_DRIFT
    return weight, (phi[:, None] * left + ANTI_DRIFT * data) / weight[:, None]

"""Patches of a mesh that oscillate between their observations.

A polynomial may pass near every vertex and centroid and still swing out in between.  Such patches are rare, after the
fit as after the sweeps.  Errors at points that were not observed reveal them; they are refitted by themselves with six
observations in every triangle.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..arrays import Array, Booleans
from ..mesh.sampling import SURFACE_SAMPLES
from ..patches.observations import MeshObservations
from .patched_surface import PatchedSurface

MeshSurface = PatchedSurface[MeshObservations]

NEAR_EDGES = SURFACE_SAMPLES[3:]
"""The samples that are farthest from both vertices and centroid."""

OVERSHOOT = 2.0
"""A patch oscillates where its largest error in between exceeds the largest at its observations by this factor."""


def oscillating_on_mesh(surface: MeshSurface) -> Iterator[tuple[Booleans, MeshObservations]]:
    """Find patches that swing out between their observations, to be observed more densely (see `refit_oscillating`).

    Errors count with the patch's blending weight.
    """
    oscillating = errors_between(surface) > OVERSHOOT * _errors_observed(surface)
    if oscillating.any():
        yield oscillating, surface.observations.with_dense(oscillating)


def errors_between(surface: MeshSurface) -> Array:
    """Largest error of each patch between its observations, (K,), scene units."""
    representation, mesh = surface.representation(), surface.mesh
    errors = np.empty(len(representation.mesh_triangles))
    for rows, values in representation.at_patch_samples(NEAR_EDGES):
        corners = mesh.vertices[representation.triangles[representation.mesh_triangles[rows]]]
        flat = np.einsum("qk,tkd->tqd", NEAR_EDGES, corners)
        weights = representation.weights[representation.corners[rows]] @ NEAR_EDGES.T
        errors[rows] = (np.linalg.norm(values - flat, axis=2) * weights).max(axis=1)
    starts = representation.triangle_offsets[:-1]
    return np.maximum.reduceat(errors, starts) if len(starts) else np.zeros(0)


def _errors_observed(surface: MeshSurface) -> Array:
    observations = surface.observations
    largest = np.zeros(len(surface.patches))
    for patch, fit in enumerate(surface.fits):
        own = observations.of_patch(patch)
        error = np.linalg.norm(fit.values - observations.points[own.number], axis=1) * own.blending
        largest[patch] = error.max(initial=0.0)
    return largest

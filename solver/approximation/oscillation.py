"""Patches that oscillate between their observations.

A polynomial may pass near every vertex and centroid and still swing out in between.  Such patches are rare, after the
fit as after the sweeps; they are found by looking at points that were not observed, and fitted again by themselves with
six observations in every triangle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..fitting.chunks import PatchFit
from ..mesh.sampling import SURFACE_SAMPLES
from ..mesh.triangle_mesh import TriangleMesh
from ..patches.observations import MeshObservations
from ..settings import Settings
from ..surface.assembly import assemble

NEAR_EDGES = SURFACE_SAMPLES[3:]
"""The points that are farthest from both vertices and centroid."""

OVERSHOOT = 2.0
"""A patch overshoots where its largest error in between is so many times the largest at its observations."""


def overshooting(
    mesh: TriangleMesh, observations: MeshObservations, fits: list[PatchFit], settings: Settings
) -> NDArray[np.bool_]:
    """Which patches swing out between their observations, (K,); errors count with the patch's blending weight."""
    return errors_between(mesh, observations, fits, settings) > OVERSHOOT * _errors_observed(observations, fits)


def errors_between(
    mesh: TriangleMesh, observations: MeshObservations, fits: list[PatchFit], settings: Settings
) -> NDArray[np.float64]:
    """Largest error of each patch between its observations, (K,), scene units."""
    surface = assemble(mesh, observations.patches, observations.blending, fits, settings)
    errors = np.empty(len(surface.mesh_triangles))
    for rows, values in surface.at_patch_samples(NEAR_EDGES):
        flat = np.einsum("qk,tkd->tqd", NEAR_EDGES, mesh.vertices[surface.triangles[surface.mesh_triangles[rows]]])
        weights = surface.weights[surface.corners[rows]] @ NEAR_EDGES.T
        errors[rows] = (np.linalg.norm(values - flat, axis=2) * weights).max(axis=1)
    return np.maximum.reduceat(errors, surface.triangle_offsets[:-1]) if len(fits) else np.zeros(0)


def _errors_observed(observations: MeshObservations, fits: list[PatchFit]) -> NDArray[np.float64]:
    largest = np.zeros(len(fits))
    for patch, fit in enumerate(fits):
        own = observations.of_patch(patch)
        error = np.linalg.norm(fit.values - observations.points[own.number], axis=1) * own.blending
        largest[patch] = error.max(initial=0.0)
    return largest

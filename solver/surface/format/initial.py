"""Initial domains, found again: the same map, in the same frames."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from ...arrays import Array
from ...fitting.batch import Problem, frame_of
from ...mesh.triangle_mesh import build_mesh
from ...patches.parameterisation import initial_domains
from ...patches.patches import Patches

DOUBTFUL = 100.0
"""A frame is wrong if turning and scaling the domain within it divides the squared distance by more than this."""

UNMOVED = 1e-5
"""Root mean square below which a domain differs from its map by rounding only, in units of the frame."""


def initial_domains_of(surface: Any, method: str) -> Array:
    """Return the initial domains of a representation, (C, M, 2), by mapping its patches to the plane again."""
    sizes = np.diff(surface.face_offsets)
    if (sizes == sizes[0]).all():
        faces = surface.face_corners.reshape(-1, sizes[0])
    else:
        faces = np.split(surface.face_corners, surface.face_offsets[1:-1])
    mesh = build_mesh(surface.vertices, faces, (surface.triangles, surface.polygon))
    nothing = np.zeros(surface.patches, dtype=np.int64)
    of_vertices = np.zeros(len(surface.patch_vertices), dtype=np.int64)
    patches = Patches(
        centres=nothing,
        rings=nothing,
        vertex_offsets=surface.vertex_offsets,
        vertices=surface.patch_vertices,
        nodes=of_vertices,
        triangle_offsets=surface.triangle_offsets,
        triangles=surface.patch_triangles,
        mesh_triangles=surface.mesh_triangles,
        rim_distance=of_vertices,
        passed_through=np.zeros(len(surface.vertices), dtype=bool),
        levels=nothing,
    )
    flat = initial_domains(mesh, patches, method)
    result, each = np.empty(surface.domains.shape), 3 // len(surface.domains)
    for first, end in pairwise(surface.vertex_offsets):
        own, at = flat[first:end], surface.vertices[surface.patch_vertices[first:end]]
        for channel, domain in enumerate(result):
            signals = at[:, channel * each : (channel + 1) * each]
            domain[first:end] = _in_frame(own, signals, surface.domains[channel, first:end])
    return result


def _in_frame(flat: Array, signals: Array, optimised: Array) -> Array:
    """Put an initial domain (m, 2) into the frame that it had when the patch was fitted.

    Methods turn it to the signals' principal axes, or do not.  A patch that bends nowhere has none, and its frame has
    another unit; it is then turned and scaled as its optimised domain, which has not moved.
    """
    none = np.zeros((0, 3), dtype=np.int64)
    problem = Problem(flat, none, signals, none, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), 0)
    found = [frame_of(problem, turn).put_in(flat) for turn in (True, False)]
    best = min(found, key=lambda domain: float(((domain - optimised) ** 2).sum()))
    laid = _laid_over(best, optimised)
    moved, changed = (float(((domain - optimised) ** 2).mean()) for domain in (best, laid))
    return laid if changed < UNMOVED**2 or moved > DOUBTFUL * changed else best


def _laid_over(domain: Array, other: Array) -> Array:
    """Turn, scale and move a domain to where it is nearest to another, by least squares."""
    middle, there = domain.mean(axis=0), other.mean(axis=0)
    (x, y), (u, v) = (domain - middle).T, (other - there).T
    size = max(float(x @ x + y @ y), 1e-300)
    real, imaginary = (x @ u + y @ v) / size, (x @ v - y @ u) / size
    return np.stack([real * x - imaginary * y, imaginary * x + real * y], axis=1) + there

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

DOUBTFUL = 4.0
"""A frame is wrong if turning the domain within it divides the squared distance by more than this."""


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

    Methods turn it to the signals' principal axes, or do not.  A patch that bends nowhere has none; it is then turned
    as its optimised domain.
    """
    none = np.zeros((0, 3), dtype=np.int64)
    problem = Problem(flat, none, signals, none, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), 0)
    found = [frame_of(problem, turn).put_in(flat) for turn in (True, False)]
    best = min(found, key=lambda domain: float(((domain - optimised) ** 2).sum()))
    laid = _laid_over(best, optimised)
    return best if ((best - optimised) ** 2).sum() <= DOUBTFUL * ((laid - optimised) ** 2).sum() + 1e-9 else laid


def _laid_over(domain: Array, other: Array) -> Array:
    """Turn and move a domain to where it is nearest to another."""
    middle, there = domain.mean(axis=0), other.mean(axis=0)
    one, two = domain - middle, other - there
    angle = np.arctan2((one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]).sum(), (one * two).sum())
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return one @ turn + there

"""The surface while it is being solved: patches that are not fitted yet are shown as quadrics.

A quadric is the least-squares fit of the six polynomials up to degree two over the patch's initial domain.  It rounds
every crease off, costs next to nothing, and gives way to the patch itself as soon as that is fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ..arrays import Array, Indices, runs_of_rows
from ..mesh.quadrics import quadric_terms
from ..mesh.topology import mean_over_nodes
from ..mesh.triangle_mesh import TriangleMesh
from ..patches.patches import Patches

RIDGE = 1e-9
"""Added to the diagonal of the normal equations, relative to its mean: a patch may have fewer than six vertices."""

ENTRIES_AT_ONCE = 500_000
"""Vertices of patches that are worked on together, to limit memory."""


class Preview:
    """The blend of the patches at the vertices, fitted or not; computed only when a preview is asked for."""

    def __init__(self, mesh: TriangleMesh, patches: Patches, domains: Array, blending: Array) -> None:
        """Remember what is covered.

        Parameters
        ----------
        mesh, patches
            The cover.
        domains
            Initial domains, (M, 2), scene units.
        blending
            Blending weights of the patches, (M,).
        """
        self._mesh, self._patches, self._domains, self._blending = mesh, patches, domains, blending
        self._points = mesh.vertices[mesh.node_vertex]

    def surface(self, blended: Array, fitted: Sequence[bool]) -> Array:
        """Return the surface at the vertices, (V, 3), with quadrics for the patches without a fit.

        Parameters
        ----------
        blended
            The blend of the fitted patches at the observations, which begin with the nodes, (O, 3): the data where
            patches are missing.
        fitted
            Which patches are fitted, (K,).
        """
        own = np.asarray(fitted, dtype=bool)[self._patches.vertex_patch]
        there = np.where(own, self._blending, 0.0)
        share = np.bincount(self._patches.nodes, weights=there, minlength=len(self._points))
        at_nodes = blended[: len(self._points)] + (1.0 - share)[:, None] * self._offsets
        return mean_over_nodes(at_nodes, self._mesh.node_vertex, len(self._mesh.vertices))

    @cached_property
    def _offsets(self) -> Array:
        """From each node to the blend of all quadrics, (N, 3); zero where no patch has weight."""
        patches = self._patches
        offsets = np.zeros_like(self._points)
        for first, end in runs_of_rows(patches.vertex_offsets, ENTRIES_AT_ONCE):
            bounds = patches.vertex_offsets[first : end + 1]
            own = slice(bounds[0], bounds[-1])
            points = self._points[patches.nodes[own]]
            towards = self._blending[own, None] * (quadrics(self._domains[own], points, bounds - bounds[0]) - points)
            for axis in range(3):
                offsets[:, axis] += np.bincount(patches.nodes[own], towards[:, axis], len(offsets))
        return offsets


def quadrics(domains: Array, points: Array, offsets: Indices) -> Array:
    """Return what the least-squares quadric of each patch is at its points, (M, 3).

    Parameters
    ----------
    domains, points
        Where the points lie in the plane, (M, 2), and in space, (M, 3).
    offsets
        Where the patches start and end, (K + 1,); none is empty.
    """
    starts, sizes = offsets[:-1], np.diff(offsets)
    patch = np.repeat(np.arange(len(sizes)), sizes)
    u, v = _normalised(domains, starts, sizes).T
    basis = quadric_terms(u, v, 1)
    functions = basis.shape[1]
    gram = np.empty((len(sizes), functions, functions))
    right = np.empty((len(sizes), functions, 3))
    for i in range(functions):
        for j in range(i + 1):
            gram[:, i, j] = gram[:, j, i] = np.add.reduceat(basis[:, i] * basis[:, j], starts)
        right[:, i] = np.add.reduceat(basis[:, i, None] * points, starts)
    trace = np.trace(gram, axis1=1, axis2=2)
    gram[:, range(functions), range(functions)] += RIDGE * trace[:, None] / functions
    coefficients = np.linalg.solve(gram, right)
    fitted: Array = np.einsum("ni,nij->nj", basis, coefficients[patch])
    return fitted


def _normalised(domains: Array, starts: Indices, sizes: Indices) -> Array:
    """Move and scale each patch's domain to mean 0 and root mean square 1."""
    centred = domains - np.repeat(np.add.reduceat(domains, starts) / sizes[:, None], sizes, axis=0)
    spread = np.sqrt(np.add.reduceat((centred**2).sum(axis=1), starts) / sizes)
    return centred / np.repeat(np.where(spread > 0.0, spread, 1.0), sizes)[:, None]

"""What the patches of a mesh are fitted to, gathered by the compiled kernel, and their blend: `observations.c`."""

from __future__ import annotations

from ctypes import Structure, byref, c_double, c_int64, c_void_p
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Booleans, Indices, offsets_of
from .library import function


class Inside(NamedTuple):
    """Points inside the triangles of a patch.

    Attributes
    ----------
    shares
        Their barycentric coordinates, (q, 3).
    first
        Number of the first point of each triangle among all observations, (T,).
    """

    shares: Array
    first: Indices


class _Inside(Structure):
    _fields_ = (("count", c_int64), ("shares", c_void_p), ("first", c_void_p))


class _Observed(Structure):
    _fields_ = (
        *((name, c_void_p) for name in ("vertex_offsets", "vertices", "nodes")),
        *((name, c_void_p) for name in ("triangle_offsets", "triangles", "mesh_triangles", "corners")),
        *((name, c_void_p) for name in ("positions", "points", "domains", "blending", "vertex_weights")),
        *((name, c_void_p) for name in ("overlap", "dense", "closely", "node_weights", "inside_weights")),
        ("inside", _Inside * 2),
    )


class _Gathered(Structure):
    _fields_ = tuple(
        (name, c_void_p)
        for name in ("domain", "triangles", "signals", "corners", "shares", "values", "weights", "number", "blending")
    )


class _Blended(Structure):
    _fields_ = (("points", c_void_p), ("blended", c_void_p))


class Blends(NamedTuple):
    """Where some patches are observed, one patch after the other, N observations in all.

    Attributes
    ----------
    offsets
        Where each patch's observations begin and end, (n + 1,).
    number, blending
        Which of all observations these are, and the patch's blending weight there, (N,).
    """

    offsets: Indices
    number: Indices
    blending: Array


class Gathered(NamedTuple):
    """What some patches are fitted to, one patch after the other: m vertices, t triangles, N observations in all.

    Attributes
    ----------
    vertices, triangle_count
        How many each patch has, (n,).
    blends
        Its observations.
    domain, triangles, signals, corners, shares, values, weights
        As in `fitting.batch.Problem`.
    """

    vertices: Indices
    triangle_count: Indices
    blends: Blends
    domain: Array
    triangles: Indices
    signals: Array
    corners: Indices
    shares: Array
    values: Array
    weights: Array


def _address(array: NDArray[Any] | None) -> int | None:
    return None if array is None else array.ctypes.data


@dataclass(frozen=True)
class Observed:
    """K patches over a mesh and what they are fitted to, with common domains.

    Attributes
    ----------
    vertex_offsets, vertices, nodes, triangle_offsets, triangles, mesh_triangles
        The patches, as in `patches.patches.Patches`.
    corners
        Their triangles from the mesh triangles' own first corner on, (S, 3).
    positions, points
        The mesh's vertices, (V, 3), and the observed points, (O, 3).
    domains, blending
        Initial domains, (M, 2), and blending weights, (M,).
    vertex_weights
        Weights of the vertices, (V,); None for ones.
    overlap
        How many patches each triangle has, (T,), where all of them count alike; else None.
    dense, closely
        Which patches are observed densely, (K,), and which triangles are in every patch, (T,).
    node_weights, inside_weights
        Weights of vertices by their nodes, (N,), and of all points inside a triangle together, (K,).
    inside
        Points inside sparsely and inside densely observed triangles.
    partition
        Whether weights follow the blending weights (see `patches.blending.fitting_weights`).
    """

    vertex_offsets: Indices
    vertices: Indices
    nodes: Indices
    triangle_offsets: Indices
    triangles: Indices
    mesh_triangles: Indices
    corners: Indices
    positions: Array
    points: Array
    domains: Array
    blending: Array
    vertex_weights: Array | None
    overlap: Indices | None
    dense: Booleans
    closely: Booleans
    node_weights: Array
    inside_weights: Array
    inside: tuple[Inside, Inside]
    partition: bool

    @cached_property
    def _native(self) -> tuple[_Observed, list[NDArray[Any] | None]]:
        """The structure that the kernel takes, and the arrays that it points at."""
        whole = (self.vertex_offsets, self.vertices, self.nodes, self.triangle_offsets, self.triangles)
        arrays: list[NDArray[Any] | None] = [
            *(np.ascontiguousarray(own, dtype=np.int64) for own in (*whole, self.mesh_triangles, self.corners)),
            *(np.ascontiguousarray(own) for own in (self.positions, self.points, self.domains, self.blending)),
            None if self.vertex_weights is None else np.ascontiguousarray(self.vertex_weights),
            None if self.overlap is None else np.ascontiguousarray(self.overlap, dtype=np.int64),
            *(np.ascontiguousarray(own, dtype=np.uint8) for own in (self.dense, self.closely)),
            *(np.ascontiguousarray(own) for own in (self.node_weights, self.inside_weights)),
        ]
        count = len(arrays)
        inside = (_Inside * 2)()
        for k, own in enumerate(self.inside):
            shares, first = np.ascontiguousarray(own.shares), np.ascontiguousarray(own.first)
            inside[k] = _Inside(len(shares), _address(shares), _address(first))
            arrays += [shares, first]
        return _Observed(*(_address(array) for array in arrays[:count]), inside), arrays

    def sizes(self, patches: Indices) -> tuple[Indices, Indices, Indices]:
        """Vertices, triangles and observations of some patches, (n,) each."""
        vertices = self.vertex_offsets[patches + 1] - self.vertex_offsets[patches]
        triangles = self.triangle_offsets[patches + 1] - self.triangle_offsets[patches]
        held = [self._closely_before[self.triangle_offsets[patches + k]] for k in (0, 1)]
        closely = np.where(self.dense[patches], triangles, held[1] - held[0])
        sparse, dense = (len(own.shares) for own in self.inside)
        return vertices, triangles, vertices + sparse * triangles + (dense - sparse) * closely

    @cached_property
    def _closely_before(self) -> Indices:
        """How many of the patches' triangles before each are observed closely in every patch, (S + 1,)."""
        return np.concatenate([[0], np.cumsum(self.closely[self.mesh_triangles])])

    def blends(self, patches: Indices) -> Blends:
        """Where some patches are observed."""
        offsets = offsets_of(self.sizes(patches)[2])
        found = Blends(offsets, np.empty(offsets[-1], dtype=np.int64), np.empty(offsets[-1]))
        self._gather(patches, _Gathered(number=_address(found.number), blending=_address(found.blending)))
        return found

    def gather(self, patches: Indices, *, fitting: bool) -> Gathered:
        """What some patches are fitted to; with the weights of a fit, or with the observations' own."""
        vertices, triangles, observations = self.sizes(patches)
        m, t, offsets = int(vertices.sum()), int(triangles.sum()), offsets_of(observations)
        count = int(offsets[-1])
        blends = Blends(offsets, np.empty(count, dtype=np.int64), np.empty(count))
        domain, signals = np.empty((m, 2)), np.empty((m, 3))
        faces, corners = (np.empty((rows, 3), dtype=np.int64) for rows in (t, count))
        shares, values, weights = np.empty((count, 3)), np.empty((count, 3)), np.empty(count)
        found = Gathered(vertices, triangles, blends, domain, faces, signals, corners, shares, values, weights)
        addresses = map(_address, (*found[3:], blends.number, blends.blending))
        self._gather(patches, _Gathered(*addresses))
        if fitting and self.partition:
            places = c_void_p(_address(blends.blending)), c_void_p(_address(weights))
            function("fitting_weights")(c_void_p(_address(offsets)), c_int64(len(patches)), *places)
        return found

    def _gather(self, patches: Indices, wanted: _Gathered) -> None:
        chosen = np.ascontiguousarray(patches, dtype=np.int64)
        native, _arrays = self._native
        function("observe_patches")(byref(native), c_void_p(_address(chosen)), c_int64(len(chosen)), byref(wanted))


@dataclass(frozen=True)
class Blend:
    """The blend of all patches at the observations: the data, and what it is so far, (O, 3) both."""

    points: Array
    blended: Array

    def exchange(self, where: Blends, before: Array | None, after: Array) -> None:
        """Replace the part of some patches; without values before, (N, 3), that part is the data."""
        _check_count(where.number, after, after if before is None else before)
        places = c_int64(len(where.number)), *(c_void_p(_address(own)) for own in where[1:])
        values = c_void_p(_address(before)), c_void_p(_address(after))
        function("exchange")(*places, *values, byref(self._native))

    def take_remainder(self, given: Gathered, fitted: Array, anti_drift: float) -> None:
        """Turn values and weights into those of a sweep, where the patches' values are `fitted`, (N, 3), so far."""
        offsets, number, blending = given.blends
        _check_count(number, fitted)
        where = c_void_p(_address(number)), c_void_p(_address(blending)), byref(self._native)
        values = c_void_p(_address(fitted)), c_double(anti_drift), *map(c_void_p, map(_address, given[-2:]))
        count = c_int64(len(offsets) - 1)
        function("against_remainder")(c_void_p(_address(offsets)), count, *where, *values)

    @property
    def _native(self) -> _Blended:
        return _Blended(_address(self.points), _address(self.blended))


def _check_count(number: Indices, *values: Array) -> None:
    """Refuse values of other observations: the kernel would read past their end."""
    if any(len(each) != len(number) for each in values):
        raise ValueError(f"there are {len(number)} observations and values of {', '.join(str(len(v)) for v in values)}")

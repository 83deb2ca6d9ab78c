"""Evaluating a finished surface by the compiled kernel: `representation.c` and `taylor.c`."""

from __future__ import annotations

from ctypes import Structure, byref, c_int64, c_void_p
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from .library import function


class Functions(NamedTuple):
    """The sparse functions of K patches.

    Attributes
    ----------
    support, coefficients
        Chosen functions of each patch and coordinate, -1 where fewer are used, and their coefficients, (K, 3, s).
    origins, scales
        value = origin + h / scale, (K, 3) and (K, C).
    degree, legendre
        The dictionary: highest total degree, and whether the basis is Legendre's.
    """

    support: Indices
    coefficients: Array
    origins: Array
    scales: Array
    degree: int
    legendre: bool


class Blend(NamedTuple):
    """Where the patches lie, and how much they count there.

    Attributes
    ----------
    triangle_offsets, mesh_triangles
        Which patch triangles belong to each patch, (K + 1,), and the mesh triangle that each is, (S,).
    corners
        Patch vertices at the corners of the patch triangles, (S, 3).
    weights, domains
        Blending weights (M,) and domains (C, M, 2) of the patch vertices.
    shares
        What the weights are multiplied by on each mesh triangle, (T,); None for ones.
    """

    triangle_offsets: Indices
    mesh_triangles: Indices
    corners: NDArray[np.integer[Any]]
    weights: Array
    domains: Array
    shares: Array | None = None


class Holders(NamedTuple):
    """Which patches hold each mesh triangle with some weight.

    Attributes
    ----------
    starts, held, patch
        The patch triangles over mesh triangle t are `held[starts[t]:starts[t + 1]]`, ascending; their patches.
    """

    starts: Indices
    held: NDArray[np.integer[Any]]
    patch: NDArray[np.integer[Any]]


class _Functions(Structure):
    _fields_ = (
        *((name, c_int64) for name in ("channels", "width", "degree", "legendre")),
        *((name, c_void_p) for name in ("support", "coefficients", "origins", "scales")),
    )


class _Blend(Structure):
    _fields_ = (
        *((name, c_int64) for name in ("patches", "vertex_count")),
        *((name, c_void_p) for name in ("triangle_offsets", "mesh_triangles", "corners")),
        *((name, c_void_p) for name in ("weights", "shares", "domains")),
    )


class _Comparison(Structure):
    _fields_ = (
        *((name, c_void_p) for name in ("vertices", "triangles")),
        ("samples", c_int64),
        *((name, c_void_p) for name in ("inside", "errors")),
    )


class _Holders(Structure):
    _fields_ = tuple((name, c_void_p) for name in ("starts", "held", "patch"))


class Memory:
    """Addresses of arrays in the form that the kernel reads; it keeps the arrays alive."""

    def __init__(self) -> None:
        self._arrays: list[NDArray[Any]] = []

    def whole(self, array: NDArray[Any]) -> int:
        return self._kept(np.ascontiguousarray(array, dtype=np.int64))

    def short(self, array: NDArray[Any]) -> int:
        return self._kept(np.ascontiguousarray(array, dtype=np.int32))

    def real(self, array: NDArray[Any]) -> int:
        return self._kept(np.ascontiguousarray(array, dtype=np.float64))

    def functions(self, own: Functions) -> _Functions:
        return _Functions(
            own.scales.shape[1],
            own.support.shape[2],
            own.degree,
            own.legendre,
            self.whole(own.support),
            self.real(own.coefficients),
            self.real(own.origins),
            self.real(own.scales),
        )

    def blend(self, own: Blend) -> _Blend:
        return _Blend(
            len(own.triangle_offsets) - 1,
            own.domains.shape[1],
            self.whole(own.triangle_offsets),
            self.whole(own.mesh_triangles),
            self.short(own.corners),
            self.real(own.weights),
            None if own.shares is None else self.real(own.shares),
            self.real(own.domains),
        )

    def holders(self, own: Holders) -> _Holders:
        return _Holders(self.whole(own.starts), self.short(own.held), self.short(own.patch))

    def _kept(self, array: NDArray[Any]) -> int:
        self._arrays.append(array)
        return array.ctypes.data


def call(name: str, *arguments: Any) -> None:
    if function(name)(*arguments):
        raise MemoryError("There is not enough memory to evaluate the surface.")


def patch_values(functions: Functions, first: int, offsets: Indices, domain: Array) -> Array:
    """Values (N, 3) of patches from `first` on at parameters (C, N, 2) that are split at `offsets`."""
    memory, values = Memory(), np.empty((domain.shape[1], 3))
    native, count = memory.functions(functions), len(offsets) - 1
    places = (c_void_p(address) for address in (memory.whole(offsets), memory.real(domain), memory.real(values)))
    call("patch_values", byref(native), c_int64(first), c_int64(count), *places)
    return values


def with_patches(
    functions: Functions, blend: Blend, holders: Holders, where: tuple[Indices, Indices], inside: Array, sums: Array
) -> Array:
    """`sums` and what the patches contribute to the surface at points that are sorted by triangle.

    Parameters
    ----------
    where
        Mesh triangles (n,) and offsets (n + 1,): the points from `offsets[k]` to `offsets[k + 1]` lie in the k-th.
    inside
        Barycentric coordinates, (3, N).
    sums
        Of the points (3, N), or of points and derivatives along the triangle's edges 0 -> 1 and 0 -> 2, (9, N); added
        to in place where a point's numbers stand together.
    """
    memory, points = Memory(), np.ascontiguousarray(sums.T)
    patches = byref(memory.functions(functions)), byref(memory.blend(blend)), byref(memory.holders(holders))
    runs = *(c_void_p(memory.whole(own)) for own in where), c_int64(len(where[0]))
    tangents = c_int64(len(sums) == 9)
    call("add_patches", *patches, *runs, c_void_p(memory.real(inside.T)), tangents, c_void_p(points.ctypes.data))
    return points.T


def largest_errors(
    functions: Functions,
    blend: Blend,
    run: tuple[int, int],
    flat: tuple[Array, Indices],
    samples: Array,
    errors: Array,
) -> None:
    """Put the largest distance of patch triangles from their flat ones, times the blending weight, into `errors`, (S,).

    Parameters
    ----------
    run
        The first of the patches that are compared, and one past the last.
    flat
        The mesh: vertices (V, 3), triangles (T, 3).
    samples
        Barycentric coordinates of the places that are compared in every triangle, (q, 3).
    """
    memory, own = Memory(), slice(*run)
    tables = {name: getattr(functions, name)[own] for name in ("support", "coefficients", "origins", "scales")}
    native = memory.functions(functions._replace(**tables))
    where = memory.blend(blend._replace(triangle_offsets=blend.triangle_offsets[run[0] : run[1] + 1]))
    points, corners, inside = memory.real(flat[0]), memory.whole(flat[1]), memory.real(samples)
    comparison = _Comparison(points, corners, len(samples), inside, memory.real(errors))
    call("largest_errors", byref(native), byref(where), byref(comparison))

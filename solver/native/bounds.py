"""Bounding the errors of a finished surface by the compiled kernel: `bounds.c`, `taylor.c` and `closing.c`."""

from __future__ import annotations

from ctypes import Structure, byref, c_double, c_int64, c_void_p
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Indices
from .surface import Blend, Functions, Holders, Memory, call


class Limits(NamedTuple):
    """Largest derivatives of the one-variable polynomials, as in `surface.taylor.DerivativeBounds`."""

    low: float
    width: float
    levels: Array


class Correction(NamedTuple):
    """What closes a surface along its creases, as in `surface.closing.Closing`; bounds of |B_e| and |B_e''|, (P,)."""

    row: Indices
    corners: Array
    edge: Indices
    polynomials: Array
    largest: Array
    bend: Array


class Parts(NamedTuple):
    """Parts of mesh triangles: the triangles (P,), the parts' corners in their barycentric coordinates (P, 3, 3)."""

    triangle: Indices
    corners: Array


class Compared(NamedTuple):
    """What the surface is compared with.

    Attributes
    ----------
    triangles, vertices
        The flat triangles, (T, 3) and (V, 3).
    input, input_weights
        What shows through the patches, (V, 3), and how much at the triangles' corners, (T, 3).
    """

    triangles: Indices
    vertices: Array
    input: Array
    input_weights: Array


class _Limits(Structure):
    _fields_ = (
        *((name, c_double) for name in ("low", "width")),
        *((name, c_int64) for name in ("order", "cells")),
        ("levels", c_void_p),
    )


class _Correction(Structure):
    _fields_ = (
        *((name, c_void_p) for name in ("row", "corners", "edge")),
        ("terms", c_int64),
        *((name, c_void_p) for name in ("polynomials", "largest", "bend")),
    )


class _Parts(Structure):
    _fields_ = (
        *((name, c_int64) for name in ("count", "places")),
        *((name, c_void_p) for name in ("triangle", "corners", "triangles", "vertices", "input", "input_weights")),
        *((name, c_void_p) for name in ("lattice", "to_bernstein", "lower", "upper")),
    )


def bound_parts(
    functions: Functions,
    blend: Blend,
    holders: Holders,
    limits: Limits,
    correction: Correction | None,
    parts: Parts,
    compared: Compared,
    lattice: tuple[Array, Array],
) -> tuple[Array, Array]:
    """Bound the largest error on each part.

    Parameters
    ----------
    correction
        None where the surface has no creases.
    lattice
        Barycentric coordinates of the places that fix a polynomial, (L, 3), and the matrix that takes values there to
        Bernstein coefficients, (L, L).

    Returns
    -------
    lower, upper
        (P,) each, scene units.
    """
    memory, (places, to_bernstein) = Memory(), lattice
    lower, upper = np.empty(len(parts.triangle)), np.empty(len(parts.triangle))
    _, orders, cells, _ = limits.levels.shape
    most = _Limits(limits.low, limits.width, orders - 1, cells, memory.real(limits.levels))
    native = _Parts(
        len(lower),
        len(places),
        memory.whole(parts.triangle),
        memory.real(parts.corners),
        memory.whole(compared.triangles),
        *(memory.real(own) for own in compared[1:]),
        memory.real(places),
        memory.real(to_bernstein.T),
        memory.real(lower),
        memory.real(upper),
    )
    patches = byref(memory.functions(functions)), byref(memory.blend(blend)), byref(memory.holders(holders))
    closing = None if correction is None else byref(_correction(correction, memory))
    call("bound_parts", *patches, byref(most), closing, byref(native))
    return lower, upper


def _correction(own: Correction, memory: Memory) -> _Correction:
    return _Correction(
        memory.whole(own.row),
        memory.real(own.corners),
        memory.whole(own.edge),
        own.polynomials.shape[1],
        *(memory.real(values) for values in own[3:]),
    )

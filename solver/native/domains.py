"""Steps towards what sparse functions come nearest to, by the compiled kernel: `domains.c`."""

from __future__ import annotations

from ctypes import Structure, byref, c_double, c_int64, c_void_p

import numpy as np

from ..arrays import Array, Indices
from .library import function


class _SparsePatches(Structure):
    _fields_ = (
        *((name, c_int64) for name in ("signals", "width", "degree", "legendre")),
        *((name, c_void_p) for name in ("degree_u", "degree_v", "coefficients")),
    )


class SparsePatches:
    """The sparse functions of K patches: degrees in u and v, (K, r, s, 2), and coefficients, (K, r, s)."""

    def __init__(self, degrees: Indices, coefficients: Array, degree: int, legendre: bool) -> None:
        self._u, self._v = (np.ascontiguousarray(degrees[..., k], dtype=np.int32) for k in (0, 1))
        self._coefficients = np.ascontiguousarray(coefficients, dtype=np.float64)
        self._signals, self._width, self._degree, self._legendre = *coefficients.shape[1:], degree, legendre

    def steps_towards(self, patch: Indices, place: Array, target: Array, damping: float) -> tuple[Array, Array]:
        """One Gauss-Newton step from places (n, 2) towards targets (n, r), and the functions' speeds, (n, 2) both."""
        given = [np.ascontiguousarray(patch, dtype=np.int64), *(np.ascontiguousarray(own) for own in (place, target))]
        step, speed = np.empty_like(given[1]), np.empty_like(given[1])
        addresses = (c_void_p(own.ctypes.data) for own in (self._u, self._v, self._coefficients))
        own = _SparsePatches(self._signals, self._width, self._degree, self._legendre, *addresses)
        failed = function("steps_towards")(
            byref(own),
            c_int64(len(patch)),
            *(c_void_p(array.ctypes.data) for array in given),
            c_double(damping),
            c_double(np.finfo(float).tiny),
            *(c_void_p(array.ctypes.data) for array in (step, speed)),
        )
        if failed:
            raise MemoryError("There is not enough memory to read the domains.")
        return step, speed

"""Steps towards what sparse functions come nearest to, by the compiled kernel: `domains.c`."""

from __future__ import annotations

from ctypes import Structure, byref, c_double, c_int64, c_void_p
from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Indices
from .library import function


class _SparsePatches(Structure):
    _fields_ = (
        *((name, c_int64) for name in ("signals", "width", "degree", "legendre")),
        *((name, c_void_p) for name in ("degree_u", "degree_v", "coefficients")),
    )


class _Damping(Structure):
    _fields_ = (*((name, c_double) for name in ("share", "tiny", "longest", "far")),)


@dataclass(frozen=True)
class Damping:
    """How steps are damped.

    Attributes
    ----------
    share
        What is added to the diagonal of the normal equations, a share of its sum.
    longest
        Longest step along each parameter.
    far
        A longer first step is followed by a second.
    """

    share: float
    longest: float
    far: float

    def structure(self) -> _Damping:
        """The same as the kernel takes it."""
        return _Damping(self.share, np.finfo(float).tiny, self.longest, self.far)


class SparsePatches:
    """The sparse functions of K patches: degrees in u and v, (K, r, s, 2), and coefficients, (K, r, s)."""

    def __init__(self, degrees: Indices, coefficients: Array, degree: int, legendre: bool) -> None:
        self._u, self._v = (np.ascontiguousarray(degrees[..., k], dtype=np.int32) for k in (0, 1))
        self._coefficients = np.ascontiguousarray(coefficients, dtype=np.float64)
        addresses = (c_void_p(own.ctypes.data) for own in (self._u, self._v, self._coefficients))
        self.own = _SparsePatches(*coefficients.shape[1:], degree, legendre, *addresses)

    def nearer(self, patch: Indices, place: Array, target: Array, damping: Damping) -> tuple[Array, Array]:
        """One Gauss-Newton step from places (n, 2) towards targets (n, r), or two where the first is long.

        Returns
        -------
        The new places, and the functions' speeds at the last step, (n, 2) both.
        """
        given = [np.ascontiguousarray(patch, dtype=np.int64), *(np.ascontiguousarray(own) for own in (place, target))]
        found, speed = np.empty_like(given[1]), np.empty_like(given[1])
        failed = function("steps_towards")(
            byref(self.own),
            byref(damping.structure()),
            c_int64(len(patch)),
            *(c_void_p(array.ctypes.data) for array in given),
            *(c_void_p(array.ctypes.data) for array in (found, speed)),
        )
        if failed:
            raise MemoryError("There is not enough memory to read the domains.")
        return found, speed

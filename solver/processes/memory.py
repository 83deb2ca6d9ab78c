"""What the operating system says of this process."""

from __future__ import annotations

import ctypes
import re
import sys
from pathlib import Path


def peak_memory_mb() -> float:
    """Largest resident memory of this process so far, in megabytes; zero where the system does not tell."""
    if sys.platform == "win32":
        return _windows_peak_bytes() / 1e6
    status = Path("/proc/self/status")
    own = re.search(r"VmHWM:\s+(\d+) kB", status.read_text()) if status.exists() else None
    if own is not None:  # what follows also charges a process with what its parent held when it started it
        return float(own[1]) * 1024.0 / 1e6
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # kilobytes on Linux, bytes on macOS
    return float(peak) * (1.0 if sys.platform == "darwin" else 1024.0) / 1e6


MANY_VERTICES = 100_000
"""Smaller meshes free so little that to be given the pages again costs more: a tenth of a run on 6,000 vertices."""


def give_back(vertices: int = MANY_VERTICES) -> None:
    """Return freed memory to the system where the C library keeps it: glibc does between arrays that are still used.

    Nothing is done where what was freed belonged to a mesh of few vertices.
    """
    if sys.platform == "linux" and vertices >= MANY_VERTICES:
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(ctypes.c_size_t(0))


def _windows_peak_bytes() -> int:
    class Counters(ctypes.Structure):
        _fields_ = [("size", ctypes.c_uint32), ("faults", ctypes.c_uint32)] + [
            (name, ctypes.c_size_t)
            for name in ("peak", "now", "peak_paged", "paged", "peak_pool", "pool", "pagefile", "peak_pagefile")
        ]

    counters = Counters(size=ctypes.sizeof(Counters))
    windll = getattr(ctypes, "windll")  # noqa: B009 - exists on Windows only, which type checkers elsewhere do not know
    process = ctypes.c_void_p(windll.kernel32.GetCurrentProcess())
    found = windll.psapi.GetProcessMemoryInfo(process, ctypes.byref(counters), counters.size)
    return int(counters.peak) if found else 0

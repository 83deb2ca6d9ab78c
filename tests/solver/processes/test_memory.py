"""What is freed between arrays that stay goes back to the system."""

from __future__ import annotations

import platform
from pathlib import Path

import numpy as np
import pytest
from sparse_surface.solver.processes.memory import give_back


def resident() -> int:
    """Memory of this process that lies in the machine's, bytes."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return 4096 * pages


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries have no such function")
def test_memory_between_arrays_that_stay_is_given_back() -> None:
    arrays = [np.ones(8_000) for _ in range(4_000)]  # too small for memory of their own: 256 MB
    kept = arrays[::8]
    before = resident()
    del arrays
    give_back()
    assert before - resident() > 150e6
    assert all((array == 1.0).all() for array in kept)

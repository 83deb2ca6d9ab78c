"""Each step of a computation runs on one BLAS thread; between the steps the caller has its own number again."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

import numpy as np
import pytest
from sparse_surface.solver import (
    approximate,
    approximate_steps,
    denoise_steps,
    reconstruct_parts_steps,
    reconstruct_steps,
    resample_steps,
)
from sparse_surface.solver.distance.alignment import align_steps
from sparse_surface.solver.distance.distance import distance_steps
from sparse_surface.solver.distance.surfaces import Surface
from sparse_surface.solver.processes.threads import on_one_thread
from sparse_surface.solver.progress import Progress, Steps
from sparse_surface.solver.reconstruction.made_base import make_base_steps
from threadpoolctl import threadpool_info, threadpool_limits

from ..synthetic import grid

AROUND = ("sparse_surface.solver.processes.threads", "sparse_surface.solver.progress")
"""Where the number is set, and what passes steps on."""


def blas_threads() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def sheet() -> tuple[Any, Any]:
    """A bent sheet of 15 by 15 vertices."""
    places, triangles = grid(15, seed=3)
    flat = np.asarray(places)[:, :2]
    return np.column_stack([flat, 0.3 * np.sin(2.0 * flat[:, 0])]), triangles


def surface() -> Surface:
    return Surface.of(*sheet())


COMPUTATIONS: dict[str, Callable[[], Steps[Any]]] = {
    "approximate": lambda: approximate_steps(*sheet()),
    "denoise": lambda: denoise_steps(*sheet()),
    "reconstruct": lambda: reconstruct_steps(sheet()[0], *sheet()),
    "reconstruct_parts": lambda: reconstruct_parts_steps(sheet()[0], *sheet()),
    "make_base": lambda: make_base_steps(sheet()[0]),
    "resample": lambda: resample_steps(approximate(*sheet()).representation, 1),
    "distance": lambda: distance_steps(surface(), surface()),
    "align": lambda: align_steps(surface(), surface()),
}


def test_a_step_has_one_thread_and_its_caller_all() -> None:
    seen = []

    @on_one_thread
    def computation(count: int) -> Steps[int]:
        for number in range(count):
            seen.append(blas_threads())
            yield Progress("Counting", number / count)
        return count

    with threadpool_limits(2, user_api="blas"):
        steps = computation(3)
        for _ in steps:
            assert blas_threads() == {2}
    assert seen == [{1}, {1}, {1}]


@pytest.mark.parametrize("name", COMPUTATIONS)
def test_every_computation_is_limited(name: str) -> None:
    """Looks at the number of threads at every 50th call from the solver's own modules."""
    steps, calls = COMPUTATIONS[name](), itertools.count()
    seen: list[set[int]] = []

    def look(frame: FrameType, event: str, _: Any) -> None:
        module = str(frame.f_globals.get("__name__", ""))
        own = module.startswith("sparse_surface.solver.") and module not in AROUND
        if event == "c_call" and own and next(calls) % 50 == 49 and len(seen) < 50:
            seen.append(blas_threads())

    with threadpool_limits(2, user_api="blas"):
        sys.setprofile(look)
        try:
            for _ in steps:
                pass
        finally:
            sys.setprofile(None)
        assert blas_threads() == {2}
        assert seen
        assert all(found == {1} for found in seen)

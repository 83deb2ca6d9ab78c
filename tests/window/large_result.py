"""What a child process does instead of solving: it makes a result of any size, whose arrival is timed."""

from __future__ import annotations

import time
from importlib import import_module

import numpy as np

STORED_BYTES = 77
"""Of the representation, for each vertex; measured on a creased sheet."""


def solve(package: str, count: int):
    """Return the steps that make a result of `count` vertices; `package` is the solver's name in the child."""
    progress = import_module(f"{package}.progress")
    stored = import_module(f"{package}.interchange").StoredRepresentation
    result = import_module(f"{package}.approximation.result").Approximation
    random = np.random.default_rng(0)
    numbers = random.random((count, 4))
    made = result(
        numbers[:, :3].astype(np.float32),
        numbers[:, 3].copy(),
        np.zeros(count, dtype=np.int32),
        random.random(2 * count),
        {},
        stored(random.bytes(STORED_BYTES * count)),
    )
    yield progress.Progress("Made", 0.5)
    time.sleep(2.0)
    return made

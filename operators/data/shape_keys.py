"""The iterations of a result as shape keys: one slider, the Evaluation Time, goes through them."""

from __future__ import annotations

from typing import Any

import numpy as np
from bpy.types import Object
from numpy.typing import NDArray

RESULT_KEY = "Result"


def add_iteration_keys(made: Object, positions: NDArray[np.floating[Any]]) -> None:
    """Keep each iteration of a result as an absolute shape key.

    The reference key is the result itself, at time 0, so that the object looks as if it had no keys; iteration i stands
    at time 10 i.

    Parameters
    ----------
    made
        The result object, its mesh at its final positions.
    positions
        Local positions after each iteration, (n, V, 3).
    """
    made.shape_key_add(name=RESULT_KEY, from_mix=False)
    for number, points in enumerate(positions, start=1):
        key = made.shape_key_add(name=f"Iteration {number}", from_mix=False)
        key.interpolation = "KEY_LINEAR"
        key.data.foreach_set("co", np.ascontiguousarray(points, dtype=np.float32).ravel())
    keys = made.data.shape_keys
    keys.use_relative = False
    keys.eval_time = 0.0
    made.active_shape_key_index = 0

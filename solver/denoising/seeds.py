"""An order of which every beginning is spread evenly, and signs in which there is no order."""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices

GOLDEN = 0.6180339887498949


def scattered(numbers: Indices) -> Indices:
    """Return the numbers in an order of which every prefix is spread evenly over them."""
    return numbers[np.argsort(np.arange(len(numbers)) * GOLDEN % 1.0, kind="stable")]


def signs(count: int) -> Array:
    """Return as many ones as minus ones on average, always the same: noise of variance 1 to try linear steps with."""
    return 2 * np.random.default_rng(0).integers(0, 2, count).astype(np.float64) - 1

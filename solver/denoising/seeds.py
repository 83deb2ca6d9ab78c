"""An order of which every beginning is spread evenly."""

from __future__ import annotations

import numpy as np

from ..arrays import Indices

GOLDEN = 0.6180339887498949


def scattered(numbers: Indices) -> Indices:
    """Return the numbers in an order of which every prefix is spread evenly over them."""
    return numbers[np.argsort(np.arange(len(numbers)) * GOLDEN % 1.0, kind="stable")]

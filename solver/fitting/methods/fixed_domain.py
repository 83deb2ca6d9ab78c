"""Traditional sparse representation: matching pursuit over the initial domain, which stays as it is (Fig. 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...settings import Settings
from ..batch import Batch
from ..dictionary import Dictionary
from ..solution import Solution, Trace
from .variable_projection import Fit, as_wide_as, least_squares, merge, select

Indices = NDArray[np.int64]


def solve(batch: Batch, dictionary: Dictionary, settings: Settings) -> Solution:
    """Choose and fit the functions of every problem over its initial domain."""
    fit = select(batch, dictionary, batch.start, settings.sparsity, settings.pursuit)
    return _unmoved(batch, dictionary, settings, fit)


def improve(batch: Batch, dictionary: Dictionary, settings: Settings, support: Indices) -> Solution:
    """Choose anew for changed data, and keep the earlier functions (B, D, s) where they serve better."""
    anew = select(batch, dictionary, batch.start, settings.sparsity, settings.pursuit)
    earlier = least_squares(batch, dictionary, batch.start, as_wide_as(anew, support))
    return _unmoved(batch, dictionary, settings, merge(anew.misfit < earlier.misfit, anew, earlier))


def _unmoved(batch: Batch, dictionary: Dictionary, settings: Settings, fit: Fit) -> Solution:
    trace = Trace(settings.keep_iterations)
    trace.note(
        batch,
        fit.misfit,
        fit.residual,
        lambda: dictionary.sparse_values(fit.support, fit.coefficients, batch.start[:, :, None]),
    )
    return Solution(batch.start, fit.support, fit.coefficients, trace)

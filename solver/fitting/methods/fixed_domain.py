"""Traditional sparse representation: a pursuit over the initial domain, which stays fixed (Fig. 4)."""

from __future__ import annotations

from ...arrays import Array, Indices
from ...settings import Settings
from ..batch import Batch
from ..dictionary import Dictionary
from ..solution import Solution, Trace
from ..sparse_fit import Fit, as_wide_as, least_squares, merge, select


def solve(batch: Batch, dictionary: Dictionary, settings: Settings) -> Solution:
    """Choose and fit the functions of every problem over its initial domain."""
    fit = select(batch, dictionary, batch.start, settings.sparsity, settings.pursuit)
    return _unmoved(batch, dictionary, settings, fit)


def improve(
    batch: Batch, dictionary: Dictionary, settings: Settings, domain: Array, support: Indices, iterations: int
) -> Solution:
    """Choose functions for the changed data, and keep the earlier ones (B, D, s) where they fit better."""
    new = select(batch, dictionary, batch.start, settings.sparsity, settings.pursuit)
    earlier = least_squares(batch, dictionary, batch.start, as_wide_as(new, support))
    return _unmoved(batch, dictionary, settings, merge(new.misfit < earlier.misfit, new, earlier))


def _unmoved(batch: Batch, dictionary: Dictionary, settings: Settings, fit: Fit) -> Solution:
    trace = Trace(settings.keep_iterations)
    trace.note(batch, fit.misfit, fit.residual, dictionary, fit.support, fit.coefficients, batch.start)
    return Solution(batch.start, fit.support, fit.coefficients, trace)

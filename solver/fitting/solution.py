"""What every patch solver returns: domains, sparse coefficients, and a trace of the iterations."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..arrays import Array, Indices, padded_rows
from .batch import Batch
from .dictionary import Dictionary


@dataclass
class Trace:
    """What a solver notes after each iteration, or of its start where it makes none.

    Attributes
    ----------
    energy
        Objective of eq. 3 with the weights of that iteration, a list of (B,).
    squared_error
        Sum over the observations of the squared misfit, not weighted, a list of (B,).
    values
        Fitted values at the vertices, a list of (B, D, m); empty unless `keep_values`.
    keep_values
        Whether values are kept.

    All in the problems' frames.
    """

    keep_values: bool = False
    energy: list[Array] = field(default_factory=list)
    squared_error: list[Array] = field(default_factory=list)
    values: list[Array] = field(default_factory=list)

    def note(
        self,
        batch: Batch,
        energy: Array,
        residual: Array,
        dictionary: Dictionary,
        support: Indices,
        coefficients: Array,
        domain: Array,
        which: Indices | None = None,
    ) -> None:
        """Record an iterate.

        Parameters
        ----------
        batch
            The problems.
        energy
            (B,).
        residual
            Weighted misfit at the observations, (B, D, N).
        dictionary, support, coefficients
            The fitted functions, (B, D, s); evaluated only where values are kept.
        domain
            (2, B, m).
        which
            The problems' numbers among those of the trace, all where None; the others keep their last entries.
        """
        misfit = np.divide(residual, batch.root_weights, out=np.zeros_like(residual), where=batch.root_weights > 0.0)
        _append(self.energy, energy, which)
        _append(self.squared_error, np.einsum("bdn,bdn->b", misfit, misfit), which)
        if self.keep_values:
            _append(self.values, dictionary.sparse_values(support, coefficients, domain[:, :, None]), which)

    def hold(self, iterations: int) -> None:
        """Repeat the last entry until there is one for each iteration."""
        for history in (self.energy, self.squared_error, self.values):
            history += history[-1:] * (iterations - len(history))


def _append(history: list[Array], new: Array, which: Indices | None) -> None:
    if which is None or not history:
        history.append(new)
        return
    following = history[-1].copy()
    following[which] = new
    history.append(following)


def summed_histories(histories: list[Array]) -> Array:
    """Sum the patches' histories, (n,); a shorter one counts with its last entry from then on."""
    if not histories:
        return np.zeros(0)
    rows, lengths = padded_rows(histories, 0.0), np.array([len(history) for history in histories])
    for short in np.flatnonzero((lengths > 0) & (lengths < rows.shape[1])):
        rows[short, lengths[short] :] = histories[short][-1]
    # one patch after the other, however many iterations there are
    total: Array = np.cumsum(rows, axis=0)[-1]
    return total


@dataclass(frozen=True)
class Solution:
    """Fitted problems.

    Attributes
    ----------
    domain
        (2, B, m), in the problems' frames.
    support, coefficients
        (B, D, s); support -1 and coefficient zero where fewer functions are used.
    trace
        What was noted after each iteration.
    """

    domain: Array
    support: Indices
    coefficients: Array
    trace: Trace

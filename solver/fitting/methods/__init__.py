"""The patch solvers, one a module; `patch_methods.METHODS` lists them."""

from __future__ import annotations

from importlib import import_module
from typing import Protocol, cast

from ...arrays import Array, Indices
from ...patch_methods import METHODS
from ...settings import Settings
from ..batch import Batch
from ..dictionary import Dictionary
from ..solution import Solution


class PatchSolver(Protocol):
    """What the module of a method provides, for B problems with m vertices and D signals each.

    Resolved settings in, solutions in the problems' frames out.  No problem of a batch may affect another one.
    """

    def solve(self, batch: Batch, dictionary: Dictionary, settings: Settings) -> Solution:
        """Fit every problem from its initial domain."""

    def improve(
        self, batch: Batch, dictionary: Dictionary, settings: Settings, domain: Array, support: Indices, iterations: int
    ) -> Solution:
        """Continue from an earlier solution: its domains (2, B, m) and functions (B, D, s), for changed data."""


class AnnealingSolver(PatchSolver, Protocol):
    """What the module of a method that `anneals` provides besides."""

    def iterations_down_to(self, settings: Settings, lowest: float) -> int:
        """Return the number of iterations after which beta1 would fall below `lowest`."""


def solver_of(settings: Settings) -> PatchSolver:
    """Return the module of the method that the settings name."""
    return cast(PatchSolver, import_module(f".{METHODS[settings.method].module}", __name__))


def annealing_solver_of(settings: Settings) -> AnnealingSolver | None:
    """Return the module of the method if it anneals its regularisation."""
    return cast(AnnealingSolver, solver_of(settings)) if METHODS[settings.method].anneals else None

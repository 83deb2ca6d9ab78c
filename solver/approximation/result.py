"""The result of an approximation; this module does not load SciPy, which who only shows a result need not have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ..surface.representation import Representation


@dataclass(frozen=True)
class Approximation:
    """A mesh approximated by a sparse surface.

    Attributes
    ----------
    vertices
        The surface at the input's vertices, (V, 3), of the input's floating-point type.
    error
        Distance of each vertex from the input, (V,), scene units.
    patch
        Patch with the largest blending weight at each vertex, (V,); -1 where the input passes through.
    domain_stretch
        Anisotropy of the domain transformation on each input face, (F,).
    report
        Measures, counts and times; plain values only.
    representation
        What evaluates the surface anywhere.
    history
        The surface at the input's vertices after each iteration of the patches by themselves, (n, V, 3); None unless
        `Settings.keep_iterations`.
    creases
        Edges that the optimisation treats as creases, pairs of vertices (E, 2); None unless `Settings.mark_creases`.
    """

    vertices: NDArray[np.floating[Any]]
    error: NDArray[np.float64]
    patch: NDArray[np.int32]
    domain_stretch: NDArray[np.float64]
    report: dict[str, Any]
    representation: Representation
    history: NDArray[np.float64] | None = None
    creases: NDArray[np.int64] | None = None

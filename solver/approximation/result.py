"""The result of an approximation; who only shows it need not load SciPy, so this module does not."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..errors import InputError
from ..mesh.objects import Given
from ..mesh.plotting import plot
from .report import Report

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
    measures
        Measures, counts and times.
    representation
        What evaluates the surface anywhere.
    history
        The surface at the input's vertices after each iteration of the patches by themselves, (n, V, 3); None unless
        `Settings.keep_iterations`.
    creases
        Edges that the optimisation treats as creases, pairs of vertices (E, 2); None unless `Settings.mark_creases`.
    given
        The mesh as `approximate` was given it.
    """

    vertices: NDArray[np.floating[Any]]
    error: Array
    patch: NDArray[np.int32]
    domain_stretch: Array
    measures: Report
    representation: Representation
    history: Array | None = None
    creases: Indices | None = None
    given: Given | None = None

    def as_(self, kind: str | None = None) -> Any:
        """Return the mesh that was given, with the surface's vertices.

        Parameters
        ----------
        kind
            "arrays" (vertices and faces), "trimesh", "pyvista", "open3d" or "meshio"; as it was given where None.

        Raises
        ------
        InputError
            When there is no such kind, or the library is not installed.

        Examples
        --------
        >>> from sparse_surface.solver import approximate
        >>> smooth_vertices, same_faces = approximate((vertices, faces)).as_()
        >>> smooth_vertices.shape == vertices.shape
        True
        """
        if self.given is None:
            raise InputError("This result does not know its mesh: it was made step by step, or by another process.")
        return self.given.back(self.vertices, kind)

    def plot(self) -> Any:
        """Draw the surface, coloured by its distance from the input, with PyVista or else Matplotlib.

        Returns
        -------
        The `pyvista.Plotter`, or the `matplotlib.figure.Figure`; its `show` opens a window.

        Raises
        ------
        InputError
            When neither is installed.
        """
        surface = self.representation
        return plot(self.vertices, surface.triangles, self.error)

    @cached_property
    def report(self) -> dict[str, Any]:
        """The measures as a dictionary of plain values."""
        return self.measures.as_dict()

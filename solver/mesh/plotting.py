"""A picture of a surface with its errors, by whichever library is there."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..errors import InputError

COLOURS = "viridis"


def plot(vertices: NDArray[Any], triangles: Indices, error: Array) -> Any:
    """Draw triangles (T, 3) between vertices (V, 3), coloured by the error at each vertex, (V,).

    Raises
    ------
    InputError
        When neither PyVista nor Matplotlib is installed.
    """
    if find_spec("pyvista") is not None:
        return _with_pyvista(vertices, triangles, error)
    if find_spec("matplotlib") is not None:
        return _with_matplotlib(vertices, triangles, error)
    raise InputError('Plotting takes PyVista or Matplotlib: pip install "sparse-surface[plot]".')


def _with_pyvista(vertices: NDArray[Any], triangles: Indices, error: Array) -> Any:
    pyvista = import_module("pyvista")
    cells = np.concatenate([np.full((len(triangles), 1), 3), triangles], axis=1).ravel()
    plotter = pyvista.Plotter()
    plotter.add_mesh(pyvista.PolyData(vertices, cells), scalars=error, cmap=COLOURS, scalar_bar_args={"title": "error"})
    return plotter


def _with_matplotlib(vertices: NDArray[Any], triangles: Indices, error: Array) -> Any:
    figure = import_module("matplotlib.figure").Figure(figsize=(7.0, 5.5))
    import_module("mpl_toolkits.mplot3d")  # registers the projection
    axes = figure.add_subplot(projection="3d")
    drawn = axes.plot_trisurf(*vertices.T, triangles=triangles, cmap=COLOURS, linewidth=0.0)
    drawn.set_array(error[triangles].mean(axis=1))
    axes.set_box_aspect(np.maximum(np.ptp(vertices, axis=0), 1e-9 * np.ptp(vertices, axis=0).max()))
    axes.set_axis_off()
    figure.colorbar(drawn, ax=axes, shrink=0.7, label="error")
    return figure

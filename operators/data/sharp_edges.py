"""Creases that the optimisation found, as Blender's sharp edges."""

from __future__ import annotations

from typing import Any

import numpy as np
from bpy.types import Mesh
from numpy.typing import NDArray


def mark_sharp(mesh: Mesh, pairs: NDArray[np.integer[Any]]) -> None:
    """Mark the edges between pairs of vertices (E, 2) as sharp; pairs that no edge joins are passed over."""
    ends = np.empty(2 * len(mesh.edges), dtype=np.int32)
    mesh.edges.foreach_get("vertices", ends)
    sharp = np.empty(len(mesh.edges), dtype=bool)
    mesh.edges.foreach_get("use_edge_sharp", sharp)
    sharp |= np.isin(_pair_numbers(ends.reshape(-1, 2), len(mesh.vertices)), _pair_numbers(pairs, len(mesh.vertices)))
    mesh.edges.foreach_set("use_edge_sharp", sharp)
    mesh.update()


def _pair_numbers(pairs: NDArray[np.integer[Any]], vertices: int) -> NDArray[np.int64]:
    """One number for each unordered pair."""
    low, high = np.sort(pairs.astype(np.int64), axis=1).T
    return low * vertices + high

"""Two surfaces between which distances are measured, as they travel to another process."""

from __future__ import annotations

from dataclasses import dataclass

from ..arrays import Array, Indices


@dataclass(frozen=True, eq=False)
class SurfacePair:
    """Two surfaces: vertices (V, 3), and triangles (T, 3), none for points."""

    a_vertices: Array
    a_triangles: Indices
    b_vertices: Array
    b_triangles: Indices

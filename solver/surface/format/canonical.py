"""What is written: the fields of a representation, in the order of a file, and how exactly they are kept."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...arrays import Array, Indices
from ..closing import Fans
from .cover import Cover, Incidence
from .recognition import nodes_of


class Fields(Protocol):
    """The fields of a representation; see `Representation`."""

    vertices: Array
    triangles: Indices
    polygon: Indices
    face_offsets: Indices
    face_corners: Indices
    vertex_offsets: Indices
    patch_vertices: Indices
    triangle_offsets: Indices
    patch_triangles: Indices
    mesh_triangles: Indices
    domains: Array
    initial_domains: Array
    weights: Array
    blending: str
    origins: Array
    scales: Array
    basis: str
    degree: int
    support: Indices
    coefficients: Array
    energy: Array
    corners: Indices
    creases: Indices
    fans: Fans


@dataclass(frozen=True)
class Quality:
    """How exactly values are kept; all lengths in longest sides of the box around the vertices.

    Attributes
    ----------
    domains, share
        Step of the domains, where they have the scale of the surface, or 0: as they are; wider where a patch has little
        weight, but as if it had the share at least.
    functions
        Step of coefficients and origins; 0: to the last bit.
    vertices, shown
        Step of vertices that patches cover, and of those where the input shows; 0: to the last bit.
    error
        Largest permitted move of the surface.
    quick
        Whether little time is spent on making the bytes fewer.
    """

    domains: float
    share: float
    functions: float
    vertices: float
    shown: float
    error: float
    quick: bool = False


EXACT = Quality(domains=2e-7, share=1.0, functions=0.0, vertices=0.0, shown=0.0, error=5e-7)
COMPACT = Quality(domains=1.1e-5, share=1 / 32, functions=4e-6, vertices=5e-5, shown=1e-5, error=9e-6)
PLAIN = Quality(domains=0.0, share=1.0, functions=0.0, vertices=0.0, shown=0.0, error=5e-7)
DRAFT = Quality(domains=0.0, share=1.0, functions=0.0, vertices=0.0, shown=0.0, error=0.0, quick=True)
QUALITIES = {"exact": EXACT, "compact": COMPACT, "plain": PLAIN, "draft": DRAFT}


@dataclass(frozen=True)
class Canonical:
    """Patches in the order of a file: mesh triangles and nodes ascend in each patch.

    `cover`; `rows` (M,) and `triangle_rows` (S,): where the representation has each patch vertex and triangle.
    """

    nodes: Indices
    node_vertex: Indices
    cover: Cover
    incidence: Incidence
    rows: Indices
    triangle_rows: Indices

    @classmethod
    def of(cls, surface: Fields) -> Canonical:
        count = len(surface.vertices)
        corners, entries = surface.corners, len(surface.patch_vertices)
        fans = surface.fans.corners if len(surface.creases) else None
        nodes = nodes_of(surface.triangles, count, surface.mesh_triangles, corners, entries, fans)
        node_vertex = np.arange(max(int(nodes.max(initial=-1)) + 1, count))
        node_vertex[nodes.ravel()] = surface.triangles.ravel()
        patch = np.repeat(np.arange(len(surface.triangle_offsets) - 1), np.diff(surface.triangle_offsets))
        order = np.lexsort((surface.mesh_triangles, patch))
        offsets = surface.triangle_offsets
        cover = Cover.of(nodes, len(node_vertex), offsets, surface.mesh_triangles[order])
        rows = np.zeros(len(cover.nodes), dtype=np.int64)
        rows[cover.corners.ravel()] = corners[order].ravel()
        return cls(nodes, node_vertex, cover, Incidence.of(nodes, len(node_vertex)), rows, order)

"""Flat arrays in, flat arrays out: what travels between an owner and the process that solves.

This module loads neither SciPy nor the solver, so that an owner that only shows results need not.
"""

from __future__ import annotations

import io
import pickle
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, Indices
from .mesh.quads import cut_quads
from .settings import CloudSettings

if TYPE_CHECKING:
    from .surface.representation import Representation


@dataclass(frozen=True)
class MeshArrays:
    """A polygon mesh as flat arrays.

    Attributes
    ----------
    vertices
        (V, 3) positions in scene units.
    corners
        (C,) vertex of each polygon corner, polygon after polygon.
    sizes
        (F,) number of corners of each polygon.
    triangulation
        The triangles that the polygons are split into and the polygon of each, (T, 3) and (T,); `None` where there are
        triangles and quads only: how Blender splits them is computed on access.
    weights
        (V,) observation weights in [0, 1], or `None` where all are 1.
    sharp_edges
        (n, 2) vertices of the edges that are marked as sharp, or `None` where none is.
    """

    vertices: NDArray[np.float32]
    corners: NDArray[np.int32]
    sizes: NDArray[np.int32]
    triangulation: tuple[NDArray[np.int32], NDArray[np.int32]] | None = None
    weights: NDArray[np.float32] | None = None
    sharp_edges: NDArray[np.int32] | None = None

    @property
    def triangles(self) -> NDArray[np.int32]:
        """Vertices of the triangles, (T, 3)."""
        return self._cut[0]

    @property
    def triangle_polygons(self) -> NDArray[np.int32]:
        """Polygon of each triangle, (T,)."""
        return self._cut[1]

    @property
    def triangle_count(self) -> int:
        """How many triangles there are: known before the polygons are split."""
        return len(self.corners) - 2 * len(self.sizes)

    @cached_property
    def _cut(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        return self.triangulation or cut_quads(self.vertices, self.corners, self.sizes)

    def polygons(self) -> NDArray[np.int32] | list[NDArray[np.int32]]:
        """Return the polygons as `approximate` takes them: (F, n), or a list where their sizes differ."""
        if self.sizes.size and np.all(self.sizes == self.sizes[0]):
            return self.corners.reshape(-1, int(self.sizes[0]))
        return _split(self.corners, self.sizes)


@dataclass(frozen=True)
class CloudArrays:
    """A point cloud as flat arrays, with the base mesh under it if one was chosen.

    Attributes
    ----------
    points
        (P, 3) positions in scene units.
    base_vertices
        (V, 3) positions of the base mesh; none where the base is to be made from the points.
    corners, sizes
        Polygons of the base mesh: (C,) and (F,), as in `MeshArrays`.
    cloud
        How the points are observed.
    splits
        Into how many parts the base's edges are split where the surface is evaluated; 0 gives about as many vertices
        as there are points.
    base_count
        Wanted number of vertices of a base that is made; 0: one for every 24 points, in noisy clouds for every 36.
    shift
        What was subtracted from all coordinates before, so that single precision holds them.
    colours
        Of the points, (P, 4), or None where they have none.
    normals
        Of the points, (P, 3), in the same axes, or None where they have none.
    """

    points: NDArray[np.float32]
    base_vertices: NDArray[np.float32]
    corners: NDArray[np.int32]
    sizes: NDArray[np.int32]
    cloud: CloudSettings = field(default_factory=CloudSettings)
    splits: int = 0
    base_count: int = 0
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    colours: NDArray[np.float32] | None = None
    normals: NDArray[np.float32] | None = None

    @classmethod
    def of_points(
        cls, points: NDArray[np.float32], cloud: CloudSettings, splits: int = 0, base_count: int = 0
    ) -> CloudArrays:
        """Return a cloud without a base."""
        none = np.zeros(0, dtype=np.int32)
        return cls(points, np.zeros((0, 3), dtype=np.float32), none, none, cloud, splits, base_count)

    @property
    def has_base(self) -> bool:
        """Whether a base was chosen."""
        return len(self.sizes) > 0

    def polygons(self) -> list[Indices]:
        """Return the base's polygons as `reconstruct` takes them."""
        return _split(self.corners.astype(np.int64), self.sizes)


@dataclass(frozen=True)
class CloudOutcome:
    """A reconstructed surface as a mesh.

    Attributes
    ----------
    vertices, corners, sizes
        The surface evaluated on the base with split edges: positions (P, 3), and polygons as in `MeshArrays`.
    error
        Error of the points around each vertex, (P,).
    patch
        Patch with the largest weight at each vertex, (P,).
    domain_stretch
        Anisotropy of the domain transformation on each polygon.
    point_error, point_weight
        Distance of each point from the surface, and how much it counted.
    splits
        Into how many parts the base's edges were split.
    report
        Measures, counts and times; plain values only.
    representation
        What evaluates the surface anywhere.
    made_base
        The base if it was made from the points: positions (V, 3) and triangles (T, 3).
    colours
        Colours of the points around each vertex, (P, 4), where they have some.
    """

    vertices: NDArray[np.float32]
    corners: NDArray[np.int32]
    sizes: NDArray[np.int32]
    error: Array
    patch: NDArray[np.int32]
    domain_stretch: Array
    point_error: Array
    point_weight: Array
    splits: int
    report: dict[str, Any]
    representation: Representation
    made_base: tuple[NDArray[np.float32], NDArray[np.int32]] | None = None
    colours: NDArray[np.float32] | None = None
    history: None = None


_PIECE = 1 << 17
"""Bytes that are copied between two rests."""

_REST = 1e-4
"""Seconds for other threads."""


class StoredRepresentation:
    """A `Representation` that another process made: the content of a file, opened when anything else of it is used.

    Parameters
    ----------
    draft
        What `Representation.draft` gave.
    """

    def __init__(self, draft: bytes | memoryview) -> None:
        self.draft = _copied(draft)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[pickle.PickleBuffer]]:
        return StoredRepresentation, (pickle.PickleBuffer(self.draft),)

    @cached_property
    def _opened(self) -> Representation:
        from .surface.representation import Representation  # SciPy

        return Representation.from_bytes(self.draft)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # asked for by `copy` and `pickle`
            raise AttributeError(name)
        return getattr(self._opened, name)


def _copied(content: bytes | memoryview) -> bytes:
    """Return the bytes, copied so that no other thread waits for long.

    Blender draws its panels by dozens of short calls of Python.  If this thread never rested, each of them would wait
    the 5 ms after which it has to give up Python's lock.
    """
    gathered = io.BytesIO()
    for start in range(0, len(content), _PIECE):
        gathered.write(content[start : start + _PIECE])
        time.sleep(_REST)
    return gathered.getvalue()


def _split(corners: NDArray[Any], sizes: NDArray[Any]) -> list[NDArray[Any]]:
    return np.split(corners, np.cumsum(sizes)[:-1]) if len(sizes) else []

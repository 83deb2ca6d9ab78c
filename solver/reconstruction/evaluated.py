"""A reconstruction as flat arrays, for owners that run it in a process of its own (see `job`)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..progress import Steps, within
from ..settings import MOST_AUTOMATIC_SPLITS, CloudSettings

if TYPE_CHECKING:
    from ..job import StoredRepresentation
    from ..surface.representation import Representation


@dataclass(frozen=True)
class CloudArrays:
    """A point cloud over a base mesh as flat arrays.

    Attributes
    ----------
    points
        (P, 3) scene units.
    base_vertices
        (V, 3).
    corners, sizes
        The base's polygons: vertex of each corner, polygon after polygon, (C,); corners of each polygon, (F,).
    cloud
        How the points are observed.
    splits
        Into how many parts the base's edges are split where the surface is evaluated; 0: about as many vertices as
        there are points.
    """

    points: NDArray[np.float32]
    base_vertices: NDArray[np.float32]
    corners: NDArray[np.int32]
    sizes: NDArray[np.int32]
    cloud: CloudSettings = field(default_factory=CloudSettings)
    splits: int = 0


@dataclass(frozen=True)
class CloudOutcome:
    """A reconstructed surface as a mesh.

    Attributes
    ----------
    vertices, corners, sizes
        The surface evaluated on the base with split edges: positions (P, 3) and polygons.
    error
        Error of the points around each vertex, (P,).
    patch
        Patch with the largest weight at each vertex, (P,).
    domain_stretch
        Per polygon.
    point_error, point_weight
        Distance of each point from the surface, and how much it counted.
    splits
        Into how many parts the base's edges were split.
    """

    vertices: NDArray[np.float32]
    corners: NDArray[np.int32]
    sizes: NDArray[np.int32]
    error: NDArray[np.float64]
    patch: NDArray[np.int32]
    domain_stretch: NDArray[np.float64]
    point_error: NDArray[np.float64]
    point_weight: NDArray[np.float64]
    splits: int
    report: dict[str, Any]
    representation: Representation | StoredRepresentation
    history: None = None


def automatic_splits(points: int, triangles: int) -> int:
    """Number of parts of each edge that gives a base of so many triangles about as many vertices as there are points.

    A mesh has half as many vertices as triangles, and the square of the parts as many triangles.
    """
    return int(np.clip(round(np.sqrt(2.0 * points / max(triangles, 1))), 1, MOST_AUTOMATIC_SPLITS))


def reconstruct_arrays(arrays: CloudArrays, settings: Any) -> Steps[CloudOutcome]:
    """Reconstruct, and evaluate the surface as a mesh."""
    from ..surface.metrics import domain_jacobians, domain_stretch, strongest_patch  # SciPy: only where it computes
    from ..surface.resampling import resample_steps
    from .reconstruct import reconstruct_steps

    corners = np.asarray(arrays.corners, dtype=np.int64)
    faces = np.split(corners, np.cumsum(arrays.sizes)[:-1]) if len(arrays.sizes) else []
    steps = reconstruct_steps(arrays.points, arrays.base_vertices, faces, settings, arrays.cloud)
    result = yield from within(steps, 0.0, 0.97)
    representation = result.representation
    splits = arrays.splits or automatic_splits(len(arrays.points), len(representation.triangles))
    fine = yield from within(resample_steps(representation, splits), 0.97, 1.0)
    stretch = domain_stretch(representation, domain_jacobians(representation)[0], len(representation.face_offsets) - 1)
    vertices = np.asarray(fine.vertices, dtype=np.float32)
    return CloudOutcome(
        vertices=vertices,
        corners=fine.corners.astype(np.int32),
        sizes=fine.sizes.astype(np.int32),
        error=result.error_near(np.asarray(arrays.points, dtype=np.float64), vertices.astype(np.float64)),
        patch=fine.at_vertices.nearest(strongest_patch(representation)).astype(np.int32),
        domain_stretch=stretch[fine.source_face],
        point_error=result.error,
        point_weight=result.weights,
        splits=splits,
        report=result.report,
        representation=representation,
    )

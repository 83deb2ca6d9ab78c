"""Measuring a finished surface: how far it is from its input, and what the report says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..fitting.chunks import PatchFit
from ..fitting.solution import summed_histories
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import Settings
from ..surface.metrics import normal_error, seam, statistics, surface_error
from ..surface.representation import Representation
from ..version import VERSION
from .report import Report, Stopwatch
from .runner import ChunkRunner


@dataclass(frozen=True)
class Deviation:
    """How far a surface is from what it approximates, scene units.

    Attributes
    ----------
    at_points, between
        Distances whose statistics are `Report.vertex_error` and `Report.surface_error`, of any shape.
    normal_error, size
        Mean angle between normals in degrees, and longest side of the input's bounding box.
    """

    at_points: Array
    between: Array
    normal_error: float
    size: float

    @classmethod
    def from_mesh(cls, representation: Representation, points: NDArray[Any], vertices: Array) -> Deviation:
        """Compare the surface, and its `points` at the vertices (V, 3), with the flat mesh between `vertices`."""
        stored, triangles = points.astype(np.float64), representation.triangles
        return cls(
            np.linalg.norm(stored - vertices, axis=1),
            surface_error(representation, vertices=vertices),
            normal_error(vertices, stored, triangles),
            float(np.ptp(vertices[np.unique(triangles)], axis=0).max()),
        )

    def measures(self) -> dict[str, Any]:
        """Return the parts of a report that it decides."""
        at_points, between = statistics(self.at_points), statistics(self.between.ravel())
        return {
            "vertex_error": at_points,
            "surface_error": between,
            "relative": {
                "vertex_rms": at_points["rms"] / self.size,
                "vertex_max": at_points["max"] / self.size,
                "surface_rms": between["rms"] / self.size,
                "surface_max": between["max"] / self.size,
            },
            "normal_error_degrees": self.normal_error,
        }


def mesh_counts(mesh: TriangleMesh) -> dict[str, int]:
    """Count the parts of the mesh that carries the patches, for `Report.input`."""
    return {
        "vertices": len(mesh.vertices),
        "faces": mesh.polygon_count,
        "triangles": len(mesh.triangles),
        "components": mesh.component_count,
    }


def measured_iterations(fits: list[PatchFit]) -> dict[str, list[float]]:
    """Measure the iterations of the patches by themselves, before sweeps and blending.

    Returns
    -------
    dict
        `energy`, the sum of eq. 3 over the patches in their own scales, and `patch_rms`, the root mean square distance
        from the data in scene units; after each iteration.
    """
    energy = summed_histories([fit.energy for fit in fits])
    squares = summed_histories([fit.squared_error for fit in fits])
    observations = max(sum(len(fit.values) for fit in fits), 1)
    return {"energy": energy.tolist(), "patch_rms": np.sqrt(squares / observations).tolist()}


def measure(
    representation: Representation,
    deviation: Deviation,
    settings: Settings,
    watch: Stopwatch,
    runner: ChunkRunner,
    *,
    counts: dict[str, Any],
    flipped_triangles: int,
    passed_through_vertices: int,
    iterations: dict[str, list[float]],
    cloud: dict[str, Any] | None = None,
    tolerance: dict[str, Any] | None = None,
    denoise: dict[str, Any] | None = None,
) -> Report:
    """Fill in the report of a finished surface; `counts` is `Report.input` without the size."""
    with watch.stage("measure"):
        measures = deviation.measures()
        jump, stored = seam(representation), len(representation.stored)
    return Report(
        version=VERSION,
        method=settings.method,
        settings=settings.as_dict(),
        cloud=cloud,
        input={**counts, "bounding_box_longest_side": deviation.size},
        patches=representation.patches,
        flipped_triangles=flipped_triangles,
        passed_through_vertices=passed_through_vertices,
        **measures,
        seam_max=jump,
        representation_bytes=stored,
        energy=iterations["energy"],
        iterations=iterations,
        tolerance=tolerance,
        seconds=watch.report(),
        peak_memory_mb=runner.peak_memory_mb(),
        workers=runner.workers,
        denoise=denoise,
    )

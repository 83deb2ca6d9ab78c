"""Measuring a finished surface: how far it is from its input, and what the report says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, extent_of, length_of, named_by
from ..fitting.chunks import PatchFit
from ..fitting.solution import summed_histories
from ..mesh.triangle_mesh import TriangleMesh
from ..native.library import reason_for_numpy
from ..processes.each import Each
from ..surface.creases import crease_report
from ..surface.metrics import normal_error, seam, statistics, surface_error
from ..surface.representation import Representation
from ..version import VERSION
from .patched_surface import PatchedSurface
from .report import Report, Stopwatch


@dataclass(frozen=True)
class Deviation:
    """How far a surface is from what it approximates, scene units.

    Attributes
    ----------
    at_points, between
        Distances whose statistics are `Report.vertex_error` and `Report.surface_error`, of any shape.
    normal_error, size
        Mean angle between normals in degrees, and longest side of the input's bounding box.
    bounds
        What the largest distance between the points reaches at least, and what it exceeds nowhere; None where unknown.
    """

    at_points: Array
    between: Array
    normal_error: float
    size: float
    bounds: tuple[float, float] | None = None

    @classmethod
    def from_mesh(
        cls,
        representation: Representation,
        points: NDArray[Any],
        vertices: Array,
        bounds: tuple[float, float] | None,
        each: Each = map,
    ) -> Deviation:
        """Compare the surface, and its `points` at the vertices (V, 3), with the flat mesh between `vertices`.

        `bounds` are what `error_bounds` says of them, None where it was not asked.
        """
        stored, triangles = points.astype(np.float64), representation.triangles
        return cls(
            length_of(stored - vertices),
            surface_error(representation, vertices=vertices, each=each),
            normal_error(vertices, stored, triangles),
            float(extent_of(vertices[named_by(triangles, len(vertices))]).max()),
            bounds,
        )

    @property
    def achieved(self) -> float:
        """What no distance exceeds: guaranteed where the bounds are known, else the largest that was found."""
        found = max(float(distances.max(initial=0.0)) for distances in (self.at_points, self.between))
        return found if self.bounds is None else max(found, self.bounds[1])

    def measures(self) -> dict[str, Any]:
        """Return the parts of a report that it decides."""
        at_points, between = statistics(self.at_points), statistics(self.between.ravel())
        if self.bounds is not None:
            between["max"] = max(between["max"], self.bounds[0])
            between["bound"] = max(between["max"], self.bounds[1])
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
    surface: PatchedSurface[Any],
    representation: Representation,
    deviation: Deviation,
    watch: Stopwatch,
    *,
    flipped_triangles: int,
    passed_through_vertices: int,
    vertices_reproduced: int,
    faces_turned: int,
    iterations: dict[str, list[float]],
    counts: dict[str, Any] | None = None,
    cloud: dict[str, Any] | None = None,
    cloud_distances: dict[str, Any] | None = None,
    tolerance: dict[str, Any] | None = None,
    denoise: dict[str, Any] | None = None,
) -> Report:
    """Fill in the report of a finished surface; `counts` are added to what `Report.input` says of the mesh."""
    each = surface.runner.each
    with watch.stage("measure"):
        measures = deviation.measures()
        jump = seam(representation, each)
    return Report(
        version=VERSION,
        method=surface.settings.method,
        settings=surface.settings.as_dict(),
        cloud=cloud,
        input={**_counts(surface.mesh), "bounding_box_longest_side": deviation.size, **(counts or {})},
        patches=representation.patches,
        flipped_triangles=flipped_triangles,
        passed_through_vertices=passed_through_vertices,
        vertices_reproduced=vertices_reproduced,
        faces_turned=faces_turned,
        **measures,
        seam_max=jump,
        energy=iterations["energy"],
        iterations=iterations,
        tolerance=tolerance,
        numpy_reason=reason_for_numpy(surface.settings),
        seconds=watch.report(),
        peak_memory_mb=surface.runner.peak_memory_mb(),
        workers=surface.runner.workers,
        denoise=denoise,
        creases=None if surface.settings.creases == "off" or cloud is not None else crease_report(representation, each),
        **(cloud_distances or {}),
    )


def _counts(mesh: TriangleMesh) -> dict[str, Any]:
    return {
        "vertices": len(mesh.vertices),
        "faces": mesh.polygon_count,
        "triangles": len(mesh.triangles),
        "components": mesh.component_count,
    }

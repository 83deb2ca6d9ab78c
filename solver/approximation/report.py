"""What is reported of an approximation or a reconstruction: measures, counts and times."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
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
from .runner import ChunkRunner

STAGES = ("cover", "domains", "solve", "sweeps", "refine", "blend", "measure")
"""The stages whose seconds every report has."""


@dataclass(frozen=True)
class Report:
    """Measures, counts and times; plain values only.  Errors are in scene units.

    Attributes
    ----------
    version, method, settings, cloud
        What was run; `cloud` says how points were observed and is None for a mesh.
    input
        Counts of the input, and the longest side of its bounding box.
    patches, flipped_triangles, passed_through_vertices
        Patches, their triangles whose orientation some domain turned, and vertices at which the surface is the input.
    vertex_error, surface_error, relative
        Statistics of the distances at the input's vertices and between them; for a cloud, of the points from the places
        at which they were observed and from the surface.  `relative` ones are shares of the longest side.
    seam_max, normal_error_degrees
        Largest jump across a patch's rim, and mean angle between the normals of input and surface.
    energy, iterations
        What `measured_iterations` returns; the energies are there twice.
    tolerance, denoise
        What it took to keep a tolerance, and what was done to the noise; None where nothing was asked for.
    seconds, peak_memory_mb, workers, representation_bytes
        Time of each stage and in total, largest resident memory, chunks fitted at once, size of the representation.
    """

    version: str
    method: str
    settings: dict[str, Any]
    cloud: dict[str, Any] | None
    input: dict[str, Any]
    patches: int
    flipped_triangles: int
    passed_through_vertices: int
    vertex_error: dict[str, float]
    surface_error: dict[str, float]
    relative: dict[str, float]
    seam_max: float
    representation_bytes: int
    normal_error_degrees: float
    energy: list[float]
    iterations: dict[str, list[float]]
    tolerance: dict[str, Any] | None
    seconds: dict[str, float]
    peak_memory_mb: float
    workers: int
    denoise: dict[str, Any] | None

    def as_dict(self) -> dict[str, Any]:
        """Return the report as scripts and files have it: without what does not apply."""
        found = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in found.items() if value is not None}


class Stopwatch:
    """Seconds spent in each named stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._start = time.perf_counter()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time of the block to the stage `name`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def report(self) -> dict[str, float]:
        """Return the seconds of all stages, also of those that were left out, and those since the start."""
        total = time.perf_counter() - self._start
        return {**dict.fromkeys(STAGES, 0.0), **self.seconds, "total": total}


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

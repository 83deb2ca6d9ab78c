"""What is reported of an approximation or a reconstruction; results carry it, so this module does not load SciPy."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from typing import Any, Protocol, TypeVar, cast

from ..progress import FINISH, Steps

COMPLETE = ("Blending", "Measuring")
"""Stages of the progress in which nothing is left to be refined."""

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
    vertices_reproduced, faces_turned
        Vertices copied from the input (for a cloud, the base) because no patch came close enough, and faces of the
        result whose normals are more than 90 degrees from the input's.
    vertex_error, surface_error, relative
        Statistics of the distances at the input's vertices and between them; for a cloud, of the points from the places
        at which they were observed and from the surface.  `surface_error["bound"]` is guaranteed: the error exceeds it
        nowhere (see `surface.bounds`); clouds and results that were ended early have none.  `relative` ones are shares
        of the longest side.
    points_to_surface, surface_to_points
        Nearest distances between a cloud and its surface, rms and max, in scene units and in spacings; None for a mesh.
    pieces, euler
        Connected parts of a reconstructed surface and its Euler characteristic; None for a mesh.
    seam_max, normal_error_degrees
        Largest jump across a patch's rim, and mean angle between the normals of input and surface.
    energy, iterations
        What `measured_iterations` returns; the energies are there twice.
    creases
        `edges`, `vertices` and `share_at_edge` of the creases that the surface is cut along (see
        `surface.creases.crease_report`); None where no cut was asked for.
    tolerance, denoise
        What it took to keep a tolerance, and what was done to the noise; None where nothing was asked for.
    numpy_reason
        Why NumPy fitted the patches; None where the compiled kernel did.
    seconds, peak_memory_mb, workers
        Time of each stage and in total, largest resident memory, chunks fitted at once, size of the representation.
    ended_early
        True where `FINISH` was sent before the surface was refined to its end, else None.

    Examples
    --------
    >>> from sparse_surface.solver import approximate
    >>> report = approximate(vertices, faces).measures
    >>> report.surface_error["max"] >= report.surface_error["rms"], report.as_dict()["patches"] == report.patches
    (True, True)
    """

    version: str
    method: str
    settings: dict[str, Any]
    cloud: dict[str, Any] | None
    input: dict[str, Any]
    patches: int
    flipped_triangles: int
    passed_through_vertices: int
    vertices_reproduced: int
    faces_turned: int
    vertex_error: dict[str, float]
    surface_error: dict[str, float]
    relative: dict[str, float]
    seam_max: float
    normal_error_degrees: float
    energy: list[float]
    iterations: dict[str, list[float]]
    tolerance: dict[str, Any] | None
    numpy_reason: str | None
    seconds: dict[str, float]
    peak_memory_mb: float
    workers: int
    denoise: dict[str, Any] | None
    creases: dict[str, float] | None = None
    points_to_surface: dict[str, float] | None = None
    surface_to_points: dict[str, float] | None = None
    pieces: int | None = None
    euler: int | None = None
    ended_early: bool | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return the report as scripts and files have it: without what does not apply."""
        found = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in found.items() if value is not None}


class Reported(Protocol):
    """A result with a report."""

    @property
    def measures(self) -> Report:
        """Its report."""


Result = TypeVar("Result", bound=Reported)


def noting_early_end(steps: Steps[Result]) -> Steps[Result]:
    """Relay a computation, and say in its result's report whether it was ended early."""
    request, early = None, False
    try:
        while True:
            try:
                step = steps.send(request)
            except StopIteration as end:
                result: Result = end.value
                break
            request = yield step
            early = early or (request == FINISH and step.stage not in COMPLETE)
    finally:
        steps.close()
    if not early:
        return result
    return cast(Result, replace(cast(Any, result), measures=replace(result.measures, ended_early=True)))


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

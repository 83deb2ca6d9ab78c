"""What is measured of a reconstructed surface, put together with it as the result."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..approximation.measuring import Deviation, measure
from ..approximation.report import Stopwatch
from ..arrays import Array
from ..mesh.closest_points import Footpoints
from ..mesh.projection import project
from ..settings import CloudSettings
from ..surface.metrics import domain_changes, faces_turned
from ..surface.representation import Representation
from .cleaning import CleanCloud
from .correction import nearest_on_surface
from .distances import both_ways
from .geometry import CloudGeometry
from .refined import COUNTED, Fitted, ToleranceSought
from .result import Reconstruction

LAYERED, FAR_APART = 1.5, 0.2
"""Points lie in two layers when the kurtosis of their signed distances from the surface is below the first (of two
layers it is 1, of evenly spread ones 1.8, of normal noise 3) and their rms above this share of the spacing."""

MEASURING_STEPS = 5
"""Steps towards the nearest point of the surface when errors are measured."""


def measured(
    fitted: Fitted,
    clean: CleanCloud,
    geometry: CloudGeometry,
    cloud: CloudSettings,
    watch: Stopwatch,
    sought: ToleranceSought | None,
) -> Reconstruction:
    """Measure a finished surface against all rows of its cloud; `geometry` is that of the points that count."""
    representation, mesh, points = fitted.surface.representation(), fitted.surface.mesh, clean.points
    with watch.stage("measure"):
        size = float(np.ptp(points, axis=0).max())
        angle = _normal_error(representation, fitted.feet, geometry.normals)
        deviation = Deviation(fitted.parametric, fitted.distance, angle, size)
        _, flipped = domain_changes(representation, mesh.polygon_count, fitted.surface.runner.each)
        vertices = representation.at_vertices()
    report = measure(
        fitted.surface,
        representation,
        deviation,
        watch,
        flipped_triangles=flipped,
        passed_through_vertices=int(fitted.surface.patches.passed_through.sum()),
        vertices_reproduced=fitted.copied,
        faces_turned=faces_turned(mesh.vertices, vertices, mesh.face_offsets, mesh.face_corners),
        iterations=fitted.iterations,
        counts=_counts(fitted, clean, geometry, cloud),
        cloud=cloud.as_dict(),
        cloud_distances=both_ways(representation, points, fitted.distance, geometry.spacing),
        tolerance=None if sought is None else sought.as_dict(fitted),
    )
    strays, away = _strays(fitted, clean)
    return Reconstruction(
        vertices=vertices,
        error=clean.of_rows(fitted.distance, away),
        triangle=clean.of_rows(fitted.feet.triangle, strays.triangle),
        barycentric=clean.of_rows(fitted.feet.barycentric, strays.barycentric),
        weights=clean.of_rows(fitted.weights, np.zeros(len(clean.rows))),
        used=clean.source >= 0,
        measures=report,
        representation=representation,
    )


def _counts(fitted: Fitted, clean: CleanCloud, geometry: CloudGeometry, cloud: CloudSettings) -> dict[str, Any]:
    """What `Report.input` says of the cloud."""
    return {
        **clean.counts(),
        **({} if clean.outward is None else {"normals_used": True}),
        "spacing": geometry.spacing,
        "noise": geometry.noise,
        "crease_points": len(geometry.creases) if cloud.creases else 0,
        "outliers": int((fitted.weights < COUNTED).sum()),
        "layered": _is_layered(fitted, clean.points, geometry.spacing),
    }


def _is_layered(fitted: Fitted, points: Array, spacing: float) -> bool:
    """Whether the surface runs between two layers of points (P, 3): a thin part that became one sheet."""
    representation, feet = fitted.surface.representation(), fitted.feet
    offset = points - representation.evaluate(feet.triangle, feet.barycentric)
    height = (offset * representation.normals(feet.triangle, feet.barycentric)).sum(axis=1)
    variance = float(np.mean(height**2))
    return variance > (FAR_APART * spacing) ** 2 and float(np.mean(height**4)) < LAYERED * variance**2


def _strays(fitted: Fitted, clean: CleanCloud) -> tuple[Footpoints, Array]:
    """Nearest places, and distances, of the rows that are strays; zeros for all others."""
    rows, mesh = clean.rows, fitted.surface.mesh
    triangle, barycentric, distance = np.zeros(len(rows), np.int64), np.zeros((len(rows), 3)), np.zeros(len(rows))
    which = np.flatnonzero(clean.strays)
    if len(which):
        start = project(rows[which], mesh)
        representation = fitted.surface.representation()
        feet, distance[which] = nearest_on_surface(representation, mesh, rows[which], start, MEASURING_STEPS)
        triangle[which], barycentric[which] = feet.triangle, feet.barycentric
    return Footpoints(triangle, barycentric), distance


def _normal_error(representation: Representation, feet: Footpoints, planes: Array) -> float:
    """Mean angle between the surface and the planes of the points' neighbours, with normals (P, 3), degrees."""
    normals = representation.normals(feet.triangle, feet.barycentric)
    beside = np.linalg.norm(np.cross(normals, planes), axis=1)
    angle = np.arctan2(beside, np.abs((normals * planes).sum(axis=1)))
    return float(np.degrees(angle).mean())

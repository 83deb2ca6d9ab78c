"""Distances between two surfaces, both ways: maxima between bounds, statistics over the area, values at vertices."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..processes.memory import peak_memory_mb
from ..processes.threads import on_one_thread
from ..progress import Progress, Steps, run_to_end, within
from ..version import VERSION
from .alignment import Alignment, align_steps
from .certified import Largest, largest_distance
from .settings import DistanceSettings
from .surface_pair import SurfacePair
from .surfaces import Surface
from .targets import Nearest

PLACES_AT_ONCE = 1 << 16
BOUND_TOLERANCE = 1e-6
"""Of the longest side: how close the bounds of a maximum come to each other, or `OF_DISTANCE` of the maximum."""

OF_DISTANCE = 1e-4


@dataclass(frozen=True, eq=False)
class OneWay:
    """Distances of one surface from another.

    Attributes
    ----------
    places, distance
        Where the statistics were taken, (N, 3), each for an equal share of the area, and the distances there, (N,);
        negative inside the other mesh where signs were asked for.
    vertex_distance, vertex_partner
        The distance at each vertex, (V,), and the nearest point of the other surface, (V, 3).
    largest
        The largest distance.
    signed
        Whether distances have signs.
    """

    places: Array
    distance: Array
    vertex_distance: Array
    vertex_partner: Array
    largest: Largest
    signed: bool

    def report(self) -> dict[str, Any]:
        """Return rms, mean, p95 and max of the distances, the bound that no distance exceeds, and the signed mean."""
        size = np.abs(self.distance)
        values: dict[str, Any] = {
            "rms": float(np.sqrt((size**2).mean())),
            "mean": float(size.mean()),
            "p95": float(np.percentile(size, 95.0)),
            "max": self.largest.found,
            "max_bound": self.largest.bound,
            "max_at": self.largest.place.tolist(),
            "max_partner": self.largest.partner.tolist(),
            "samples": len(size),
        }
        if self.signed:
            values["signed_mean"] = float(self.distance.mean())
            values["lowest"], values["highest"] = float(self.distance.min()), float(self.distance.max())
        return values


@dataclass(frozen=True, eq=False)
class Distances:
    """What `distance` returns.

    Attributes
    ----------
    a_to_b, b_to_a
        Distances each way; those of A after the alignment.
    alignment
        How A was moved onto B; None where that was not asked for.
    report
        Plain values: measures, histogram, settings, times.
    """

    a_to_b: OneWay
    b_to_a: OneWay
    alignment: Alignment | None
    report: dict[str, Any]


def distance(a: Any, b: Any, settings: DistanceSettings | None = None) -> Distances:
    """Measure the distances between two surfaces.

    Parameters
    ----------
    a, b
        Meshes or point clouds in the same unit of length: a `Surface`, points (N, 3), a pair of vertices and faces, a
        mesh of trimesh, PyVista, Open3D or meshio, or a file.

    Raises
    ------
    InputError
        When signs are asked for and B is a point cloud, or a surface is too small to be aligned.
    """
    one, other = (Surface.from_object(surface) for surface in (a, b))
    return run_to_end(distance_steps(one, other, settings))


@on_one_thread
def distance_steps(a: Surface, b: Surface, settings: DistanceSettings | None = None) -> Steps[Distances]:
    """Do `distance` step by step; there is nothing to finish early."""
    settings = settings or DistanceSettings()
    if settings.signed and not b.is_mesh:
        raise InputError("A point cloud has no inside: signed distances need a mesh as the second surface.")
    started = time.perf_counter()
    alignment = None
    if settings.align != "none":
        alignment = yield from within(align_steps(a, b, scaled=settings.align == "scaled"), 0.0, 0.4)
        a = a.moved(alignment.matrix)
    aligned = time.perf_counter()
    first = 0.4 if alignment else 0.0
    middle = 0.5 * (first + 1.0)
    there = yield from within(_one_way(a, b, settings, "Measuring from A to B"), first, middle)
    back = yield from within(_one_way(b, a, settings, "Measuring from B to A"), middle, 1.0)
    seconds = {"align": aligned - started, "measure": time.perf_counter() - aligned}
    return Distances(there, back, alignment, _report(a, b, settings, there, back, alignment, seconds))


def distance_of_pair(pair: SurfacePair, settings: DistanceSettings) -> Steps[Distances]:
    """Do `distance_steps` on flat arrays."""
    a = Surface.of(pair.a_vertices, pair.a_triangles)
    return (yield from distance_steps(a, Surface.of(pair.b_vertices, pair.b_triangles), settings))


def _one_way(a: Surface, b: Surface, settings: DistanceSettings, stage: str) -> Steps[OneWay]:
    signed = settings.signed and b.is_mesh
    places = a.samples(settings.samples)
    count = len(places) + len(a.vertices)
    at_vertices: list[Nearest] = []
    signs, values = [], []
    for where, start in _chunks(a.vertices):
        yield Progress(stage, 0.9 * start / count, "at vertices")
        at_vertices.append(b.target.nearest(where))
        signs.append(_signs(where, at_vertices[-1], b, signed))
    for where, start in _chunks(places) if a.is_mesh else ():
        yield Progress(stage, 0.9 * (len(a.vertices) + start) / count, f"{start:,} of {len(places):,} places")
        found = b.target.nearest(where)
        values.append(_signs(where, found, b, signed) * found.distance)
    yield Progress(stage, 0.9, "bounding the largest")
    nearest = Nearest(*(np.concatenate(parts) for parts in zip(*at_vertices, strict=True)))
    vertex_distance = np.concatenate(signs) * nearest.distance
    distances = np.concatenate(values) if a.is_mesh else vertex_distance
    largest = _largest(a, b, nearest, places, distances)
    return OneWay(places, distances, vertex_distance, nearest.foot, largest, signed)


def _chunks(points: Array) -> list[tuple[Array, int]]:
    return [(points[start : start + PLACES_AT_ONCE], start) for start in range(0, len(points), PLACES_AT_ONCE)]


def _signs(points: Array, found: Nearest, b: Surface, signed: bool) -> Array:
    return np.where(b.sides.inside(points, found), -1.0, 1.0) if signed else np.ones(len(points))


def _largest(a: Surface, b: Surface, nearest: Nearest, places: Array, distances: Array) -> Largest:
    """Return the largest distance: for a mesh between bounds, for a cloud exactly."""
    if not a.is_mesh:
        at = int(nearest.distance.argmax())
        found = float(nearest.distance[at])
        return Largest(found, found, places[at], nearest.foot[at])
    farthest = float(nearest.distance.max())
    tolerance = max(BOUND_TOLERANCE * max(a.longest_side, b.longest_side), OF_DISTANCE * farthest)
    largest = largest_distance(a.vertices, a.triangles, nearest.distance, nearest.element, b.target, tolerance)
    at = int(np.abs(distances).argmax())
    if abs(distances[at]) <= largest.found:
        return largest
    found = float(abs(distances[at]))
    return Largest(found, max(found, largest.bound), places[at], b.target.nearest(places[at : at + 1]).foot[0])


def _report(
    a: Surface,
    b: Surface,
    settings: DistanceSettings,
    there: OneWay,
    back: OneWay,
    alignment: Alignment | None,
    seconds: dict[str, float],
) -> dict[str, Any]:
    one, other = there.report(), back.report()
    inside = float((np.abs(there.distance) <= settings.tolerance).mean()) if settings.tolerance else None
    return {
        "version": VERSION,
        "settings": asdict(settings),
        "input": {
            name: {"vertices": len(s.vertices), "triangles": len(s.triangles), "longest_side": s.longest_side}
            for name, s in (("a", a), ("b", b))
        },
        "a_to_b": one,
        "b_to_a": other,
        "hausdorff": max(one["max"], other["max"]),
        "hausdorff_bound": max(one["max_bound"], other["max_bound"]),
        "inside_tolerance": inside,
        "histogram": histogram(there, settings.bins),
        "alignment": alignment.matrix.tolist() if alignment else None,
        "alignment_quality": alignment.report() if alignment else None,
        "seconds": {**seconds, "total": sum(seconds.values())},
        "peak_memory_mb": peak_memory_mb(),
    }


def histogram(measured: OneWay, bins: int) -> dict[str, Any]:
    """Return the edges of equally wide bars, from -max or 0 to max, and how many places fall into each."""
    high = float(np.abs(measured.distance).max(initial=0.0)) or 1.0
    counts, edges = np.histogram(measured.distance, bins, (-high if measured.signed else 0.0, high))
    return {"edges": edges.tolist(), "counts": counts.tolist()}

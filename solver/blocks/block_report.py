"""The report of a mesh in blocks, from those of the blocks."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..approximation.report import STAGES, Report
from ..arrays import Array
from ..fitting.solution import summed_histories
from ..settings import Settings
from ..surface.metrics import statistics
from ..version import VERSION
from .joining import Joined, longest_side
from .large_mesh import LargeMesh


def joined_report(mesh: LargeMesh, found: Joined, error: Array, settings: Settings) -> dict[str, Any]:
    """Put the reports of several blocks together.

    The errors are those of the blended surface.  Its bound is the largest of the blocks', of which it is a mean, and so
    is its largest jump; where blocks were ended early there is no bound.  Counts are summed: what lies in the halo of a
    block counts there too.  So are the seconds, those of all processes together.

    Parameters
    ----------
    mesh, found, error
        The mesh, what the blocks made of it, and how far the vertices are from it, (V,).
    settings
        What was run.
    """
    reports = [report for report in found.reports if report]
    at_vertices, between, size = statistics(error), found.between.statistics(), longest_side(mesh)
    early = any(report.get("ended_early") for report in reports)
    bound = {} if early else {"bound": max(between["max"], *(r["surface_error"]["bound"] for r in reports))}
    counts = {
        "vertices": len(mesh.positions),
        "faces": mesh.face_count,
        "triangles": mesh.triangle_count,
        "components": found.pieces,
        "bounding_box_longest_side": size,
        "coincident_vertices": _total(reports, "input", "coincident_vertices"),
    }
    return Report(
        version=VERSION,
        method=settings.method,
        settings=settings.as_dict(),
        cloud=None,
        input=counts,
        patches=_total(reports, "patches"),
        flipped_triangles=_total(reports, "flipped_triangles"),
        passed_through_vertices=int((found.patch < 0).sum()),
        vertices_reproduced=_total(reports, "vertices_reproduced"),
        faces_turned=found.turning.turned,
        vertex_error=at_vertices,
        surface_error={**between, **bound},
        relative={
            "vertex_rms": at_vertices["rms"] / size,
            "vertex_max": at_vertices["max"] / size,
            "surface_rms": between["rms"] / size,
            "surface_max": between["max"] / size,
        },
        seam_max=max(report["seam_max"] for report in reports),
        normal_error_degrees=found.turning.degrees,
        energy=_histories(reports, "energy"),
        iterations=_iterations(reports),
        tolerance=_tolerance(reports),
        numpy_reason=next((report["numpy_reason"] for report in reports if "numpy_reason" in report), None),
        seconds={name: sum(report["seconds"].get(name, 0.0) for report in reports) for name in (*STAGES, "creases")},
        peak_memory_mb=max(report["peak_memory_mb"] for report in reports),
        workers=settings.workers,
        denoise=_denoise(reports),
        creases=_creases(reports),
        ended_early=True if early else None,
    ).as_dict()


def _total(reports: list[dict[str, Any]], *names: str) -> int:
    total = 0
    for report in reports:
        value: Any = report
        for name in names:
            value = value[name]
        total += int(value)
    return total


def _histories(reports: list[dict[str, Any]], name: str) -> list[float]:
    return [float(value) for value in summed_histories([np.array(report[name]) for report in reports])]


def _iterations(reports: list[dict[str, Any]]) -> dict[str, list[float]]:
    """The patches' iterations: energies summed, distances averaged over the blocks' patches."""
    total = sum(report["patches"] for report in reports)
    weighted = [np.array(r["iterations"]["patch_rms"]) ** 2 * r["patches"] / max(total, 1) for r in reports]
    return {"energy": _histories(reports, "energy"), "patch_rms": np.sqrt(summed_histories(weighted)).tolist()}


def _creases(reports: list[dict[str, Any]]) -> dict[str, float] | None:
    found = [report["creases"] for report in reports if "creases" in report]
    if not found:
        return None
    edges = sum(each["edges"] for each in found)
    shares = sum(each["share_at_edge"] * each["edges"] for each in found)
    return {
        "edges": edges,
        "vertices": sum(each["vertices"] for each in found),
        "share_at_edge": shares / edges if edges else 1.0,
    }


def _denoise(reports: list[dict[str, Any]]) -> dict[str, Any] | None:
    """What the blocks did to the noise: means weighted by their vertices; 95th percentiles are the largest."""
    found = [report for report in reports if "denoise" in report]
    if not found:
        return None
    counts = np.array([report["input"]["vertices"] for report in found], dtype=np.float64)
    joined: dict[str, Any] = _merged("denoise", [report["denoise"] for report in found], counts / counts.sum())
    return joined


def _merged(name: str, values: list[Any], shares: Array) -> Any:
    if isinstance(values[0], dict):
        return {key: _merged(key, [value[key] for value in values], shares) for key in values[0]}
    if name == "rms":
        return float(np.sqrt(shares @ np.square(values)))
    if name in ("mean", "normal_error_degrees", "relative_noise", "noise_level", "estimated_noise_level"):
        return float(shares @ np.array(values))
    return max(values)


def _tolerance(reports: list[dict[str, Any]]) -> dict[str, Any] | None:
    found = [report["tolerance"] for report in reports if "tolerance" in report]
    if not found:
        return None
    rounds: dict[tuple[int, int], int] = {}
    for each in (each for kept in found for each in kept["rounds"]):
        key = each["ring"], each["sparsity"]
        rounds[key] = rounds.get(key, 0) + each["patches"]
    return {
        "requested": found[0]["requested"],
        "triangles_outside_at_first": sum(each["triangles_outside_at_first"] for each in found),
        "rounds": [{"ring": ring, "sparsity": sparsity, "patches": n} for (ring, sparsity), n in rounds.items()],
        "vertices_reproduced": sum(each["vertices_reproduced"] for each in found),
        "achieved": max(each["achieved"] for each in found),
    }

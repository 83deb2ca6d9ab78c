"""Measured distances in the scene: an object with the attributes `error` and `error_color`; what is said of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.types import Object
from numpy.typing import NDArray

from ...solver.atomic_files import atomic_output
from ...solver.distance.distance import Distances
from ..data.attributes import write
from ..data.colours import ColourScale
from ..data.meshes import create_mesh
from ..data.report_text import Length, translate
from ..data.result_keys import PARTNER
from ..data.results import write_error
from ..heat_map.point_shapes import create_point_shapes
from .reading import Measurable


def _figure(length: float) -> str:
    return f"{length:.4g}"


def scale_of(measured: Distances) -> ColourScale:
    """Return a scale for the distances of A: from zero, or even around it where they have signs."""
    high = float(np.abs(measured.a_to_b.vertex_distance).max(initial=0.0)) or 1e-30
    return ColourScale(-high if measured.a_to_b.signed else 0.0, high, measured.report["settings"]["tolerance"])


def moved(points: NDArray[np.floating[Any]], measured: Distances) -> NDArray[np.float64]:
    """Return points of A, (n, 3), where the alignment puts them."""
    if measured.alignment is None:
        return np.asarray(points, dtype=np.float64)
    matrix = measured.alignment.matrix
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def create_plain(surface: Measurable) -> Object:
    """Make an object of a surface in the scene, without distances; points become small bodies that can be seen."""
    if len(surface.sizes):
        made = bpy.data.objects.new(
            surface.name, create_mesh(surface.name, surface.vertices, surface.corners, surface.sizes)
        )
    else:
        made = create_point_shapes(surface.name, surface.vertices, _spacing(surface.vertices))
    return _linked(made)


def create_measured(surface: Measurable, measured: Distances, *, visible_points: bool = False) -> Object:
    """Make an object of A with its distances, where the alignment puts it.

    With `visible_points`, points become small bodies, for pictures.
    """
    points, scale = moved(surface.vertices, measured), scale_of(measured)
    distance = measured.a_to_b.vertex_distance
    if visible_points and not len(surface.sizes):
        return _linked(create_point_shapes(surface.name, points, _spacing(points), distance, scale))
    made = bpy.data.objects.new(surface.name, create_mesh(surface.name, points, surface.corners, surface.sizes))
    write_error(made, distance, scale)
    write(made.data, {PARTNER: measured.a_to_b.vertex_partner})
    return _linked(made)


def write_csv(path: Path, measured: Distances) -> None:
    """Write each vertex of A with its distance and its partner on B; the file appears when it is complete."""
    way = measured.a_to_b
    rows = np.column_stack([np.arange(len(way.vertex_distance)), way.vertex_distance, way.vertex_partner])
    names = "vertex,distance,partner_x,partner_y,partner_z"
    with atomic_output(path) as draft:
        np.savetxt(draft, rows, fmt=["%d", *["%.9g"] * 4], delimiter=",", header=names, comments="")


def summary(one: str, other: str, report: dict[str, Any], length: Length = _figure) -> str:
    """Return the distances in one line, lengths as `length` shows them."""
    there, back = report["a_to_b"], report["b_to_a"]
    figures = (length(there[name]) for name in ("rms", "mean", "max"))
    parts = [translate("{} to {}: rms {}, mean {}, max {}").format(one, other, *figures)]
    parts.append(translate("back: rms {}, max {}").format(length(back["rms"]), length(back["max"])))
    if "signed_mean" in there:
        parts.append(translate("signed mean {}").format(length(there["signed_mean"])))
    if report["inside_tolerance"] is not None:
        tolerance = length(report["settings"]["tolerance"])
        parts.append(translate("{:.1%} within {}").format(report["inside_tolerance"], tolerance))
    quality = report["alignment_quality"]
    if quality is not None:
        text = translate("aligned to a residual of {}, overlap {:.0%}")
        parts.append(text.format(length(quality["residual"]), quality["overlap"]))
        if quality["equally_good"] > 1:
            parts.append(translate("{} positions fit equally well").format(quality["equally_good"]))
        parts += [quality["problem"].rstrip(".")] if quality["problem"] else []
    return "; ".join(parts)


def _spacing(points: NDArray[np.floating[Any]]) -> float:
    """Return about how far points are apart if they lie on a surface."""
    return float(np.ptp(points, axis=0).max()) / max(len(points), 1) ** 0.5


def _linked(made: Object) -> Object:
    bpy.context.scene.collection.objects.link(made)
    bpy.context.view_layer.update()
    return made

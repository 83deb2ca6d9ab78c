"""Surfaces from clouds that are read in parts: fitted to what thinning leaves, measured against every point."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..approximation.runner import chunk_runner
from ..arrays import Array, Indices
from ..errors import InputError
from ..mesh.closest_points import Footpoints
from ..mesh.objects import given_mesh
from ..mesh.triangle_mesh import TriangleMesh, build_mesh
from ..processes.each import Each
from ..processes.threads import on_one_thread
from ..progress import Progress, Steps, run_to_end, within
from ..settings import MOST_POINTS, CloudSettings, Settings
from ..surface.spread import Spread
from .batches import Parts, as_parts, batches
from .cleaning import CleanCloud, clean
from .correction import nearest_on_surface
from .made_base import make_base_steps
from .reconstruct import reconstruct_clean
from .result import Reconstruction
from .thinning import CHANGED, ThinCloud, thin_steps

READ, MEASURED = 0.1, 0.9
"""Shares of a run after which the points are read, and after which all are measured."""

STEPS = 8
"""Steps from the place of a cell's mean to that of a point in the cell."""

PORTION = 1 << 15
"""Points that a thread measures at once."""


@dataclass(frozen=True)
class ThinReconstruction(Reconstruction):
    """A surface fitted to the P points that thinning left.

    Attributes
    ----------
    error
        Mean distance from the surface of all that became the point, (P,), scene units.
    points, counts
        The points, (P, 3), and how many became each, (P,).
    """

    points: Array
    counts: Indices


def reconstruct_parts(
    points: ArrayLike | Parts,
    base_vertices: Any = None,
    base_faces: ArrayLike | Sequence[Sequence[int]] | None = None,
    settings: Settings | None = None,
    cloud: CloudSettings | None = None,
    *,
    most_points: int = MOST_POINTS,
    executor: Executor | None = None,
    report: Callable[[Progress], str | None] | None = None,
) -> ThinReconstruction:
    """Fit a sparse surface to a cloud that memory need not hold.

    Points are merged within the cells of a grid until `most_points` are left at most.  The surface is fitted to these,
    as `reconstruct` does, and measured against all.

    Parameters
    ----------
    points
        (P, 3), for instance mapped into memory; or an object that yields arrays (n, 3) each time that it is iterated
        over, which happens three times.
    base_vertices, base_faces
        As in `reconstruct`; None: it is made from the points.
    settings, cloud, executor, report
        As in `reconstruct`.
    most_points
        Time and memory are proportional to it.

    Raises
    ------
    InputError
        When points or base cannot be worked on, in one sentence.

    Examples
    --------
    >>> from sparse_surface.solver import reconstruct_parts
    >>> result = reconstruct_parts(points, base_vertices, base_faces, most_points=200)
    >>> result.counts.sum() == len(points), len(result.points) <= 200
    (True, True)
    """
    base = None if base_vertices is None else given_mesh(base_vertices, base_faces)
    vertices, faces = (None, None) if base is None else (base.vertices, base.faces)
    steps = reconstruct_parts_steps(
        points, vertices, faces, settings, cloud, most_points=most_points, executor=executor
    )
    return run_to_end(steps, report)


@on_one_thread
def reconstruct_parts_steps(
    points: ArrayLike | Parts,
    base_vertices: ArrayLike | None = None,
    base_faces: ArrayLike | Sequence[Sequence[int]] | None = None,
    settings: Settings | None = None,
    cloud: CloudSettings | None = None,
    *,
    most_points: int = MOST_POINTS,
    executor: Executor | None = None,
) -> Steps[ThinReconstruction]:
    """`reconstruct_parts` as a generator of `Progress`; closing it cancels, sending `FINISH` ends the fit early."""
    parts, settings, cloud = as_parts(points), settings or Settings(), cloud or CloudSettings()
    thin = yield from within(thin_steps(parts, most_points), 0.0, READ)
    found = clean(thin.points, cloud.strays == "keep", normals=thin.normals)
    start = READ
    if base_vertices is None or base_faces is None:
        start = 0.25
        made = yield from within(make_base_steps(found.points, 0, cloud.close_holes, found.outward), READ, start)
        base_vertices, base_faces = made.vertices, made.triangles
    fitting = reconstruct_clean(found, base_vertices, base_faces, settings, cloud, executor=executor)
    result = yield from within(fitting, start, MEASURED)
    return (yield from within(against_all(result, found, parts, thin, settings), MEASURED, 1.0))


def against_all(
    result: Reconstruction, clean: CleanCloud, parts: Parts, thin: ThinCloud, settings: Settings
) -> Steps[ThinReconstruction]:
    """Measure a surface that was fitted to a thinned cloud against all of its points, reading them once more.

    Parameters
    ----------
    result
        Fitted to the points of `clean`.
    clean
        The clean look at the points of `thin`, in the same order.
    parts
        What `thin` was made of.
    settings
        How many threads there are.
    """
    mesh = build_mesh(result.representation.vertices, result.representation.triangles)
    cells = len(thin.points)
    totals, spread, strays, finite = np.zeros(cells), Spread(), 0, 0
    with chunk_runner(settings.resolved(), cells) as runner:
        for batch in batches(parts):
            yield Progress("Measuring all points", min(finite / thin.extent.rows, 1.0))
            points = batch.points[np.isfinite(batch.points).all(axis=1)]
            number = thin.find(points)
            finite += len(points)
            if (number < 0).any():
                raise InputError(CHANGED)
            used = result.used[number]
            strays += int((~used).sum())
            number = number[used]
            distance = _distances(result, mesh, points[used] - thin.origin, number, runner.each)
            totals += np.bincount(number, weights=distance, minlength=cells)
            spread += Spread.of(distance)
    if finite != thin.extent.finite:
        raise InputError(CHANGED)
    error = np.where(result.used, totals / np.maximum(thin.counts, 1), result.error)
    kept = {each.name: getattr(result, each.name) for each in fields(result)}
    kept |= {"error": error, "measures": _told(result, clean, thin, spread, strays)}
    return ThinReconstruction(**kept, points=thin.points, counts=thin.counts)


def _distances(result: Reconstruction, mesh: TriangleMesh, points: Array, number: Indices, each: Each) -> Array:
    """Distances of points (n, 3) from the surface, (n,), sought from the places of their cells' means."""

    def measured(part: slice) -> Array:
        cell = number[part]
        start = Footpoints(result.triangle[cell], result.barycentric[cell])
        return nearest_on_surface(result.representation, mesh, points[part], start, STEPS)[1]

    return np.concatenate([np.zeros(0), *each(measured, _portions(len(points)))])


def _portions(count: int) -> Iterator[slice]:
    return (slice(start, start + PORTION) for start in range(0, count, PORTION))


def _told(result: Reconstruction, clean: CleanCloud, thin: ThinCloud, spread: Spread, strays: int) -> Any:
    """The report with what is known of all points."""
    report, statistics = result.measures, spread.statistics()
    size, unit = report.input["bounding_box_longest_side"], max(report.input["spacing"], 1e-300)
    rms, largest = statistics["rms"], statistics["max"]
    used, extent = report.input["used"], thin.extent
    counts = {
        "points": extent.rows,
        "not_finite": extent.rows - extent.finite,
        "strays": strays,
        "merged": extent.finite - strays - used - clean.duplicates,
        "cell": thin.grid.cell,
    }
    return replace(
        report,
        input=report.input | counts,
        surface_error=statistics,
        relative=report.relative | {"surface_rms": rms / size, "surface_max": largest / size},
        points_to_surface={
            "rms": rms,
            "max": largest,
            "rms_spacings": rms / unit,
            "max_spacings": largest / unit,
        },
    )

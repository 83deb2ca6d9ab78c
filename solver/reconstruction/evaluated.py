"""A reconstruction as flat arrays: the surface evaluated as a mesh."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..interchange import CloudArrays, CloudOutcome
from ..processes.threads import on_one_thread
from ..progress import Steps, within
from ..settings import MOST_AUTOMATIC_SPLITS, Settings
from ..surface.metrics import domain_changes, strongest_patch
from ..surface.resampling import resample_steps
from .cleaning import CleanCloud, clean
from .made_base import make_base_steps
from .reconstruct import reconstruct_clean
from .result import Reconstruction

BASE_SHARE = 0.2
"""Share of a run's time that making the base takes."""


FITTED = 0.85
"""Share of a run after which something further is done with the result."""


def automatic_splits(points: int, triangles: int) -> int:
    """Number of parts of each edge that gives a base of this many triangles about as many vertices as there are points.

    A mesh has half as many vertices as triangles, and the square of the parts as many triangles.
    """
    return int(np.clip(round(np.sqrt(2.0 * points / max(triangles, 1))), 1, MOST_AUTOMATIC_SPLITS))


Further = Callable[[Reconstruction, CleanCloud], Steps[Reconstruction]]
"""What is still to be done with a result, given the points that it was fitted to."""


@on_one_thread
def reconstruct_arrays(arrays: CloudArrays, settings: Settings, further: Further | None = None) -> Steps[CloudOutcome]:
    """Make a base where none is given, reconstruct, do what `further` does, and evaluate the surface as a mesh."""
    made, start, found = None, 0.0, {}
    normals = None if arrays.normals is None else arrays.normals.astype(np.float64)
    points = clean(arrays.points, arrays.cloud.strays == "keep", np.array(arrays.shift), normals)
    vertices, polygons = arrays.base_vertices, arrays.polygons()
    if not arrays.has_base:
        start = BASE_SHARE
        steps = make_base_steps(points.points, arrays.base_count, arrays.cloud.close_holes, points.outward)
        base = yield from within(steps, 0.0, start)
        made = base.vertices.astype(np.float32), base.triangles.astype(np.int32)
        found = {"holes_closed": base.holes_closed} if arrays.cloud.close_holes else {}
        vertices, polygons = made[0], list(base.triangles)
    fitting = reconstruct_clean(points, vertices, polygons, settings, arrays.cloud)
    fitted = 0.97 if further is None else FITTED
    result = yield from within(fitting, start, fitted)
    if further is not None:
        result = yield from within(further(result, points), fitted, 0.97)
    representation = result.representation
    splits = arrays.splits or automatic_splits(len(points.points), len(representation.triangles))
    fine = yield from within(resample_steps(representation, splits), 0.97, 1.0)
    stretch, _ = domain_changes(representation, len(representation.face_offsets) - 1)
    vertices = np.asarray(fine.vertices, dtype=np.float32)
    colours = arrays.colours
    if colours is not None:
        colours = result.carried(points.rows, vertices.astype(np.float64), colours.astype(np.float64)).astype(
            np.float32
        )
    return CloudOutcome(
        vertices=vertices,
        corners=fine.corners.astype(np.int32),
        sizes=fine.sizes.astype(np.int32),
        error=result.error_near(points.rows, vertices.astype(np.float64)),
        patch=fine.at_vertices.nearest(strongest_patch(representation)).astype(np.int32),
        domain_stretch=stretch[fine.source_face],
        point_error=result.error,
        point_weight=result.weights,
        splits=splits,
        report=result.report | {"input": result.report["input"] | found},
        representation=representation,
        made_base=made,
        colours=colours,
    )

"""Coincident vertices in `approximate`: the surface is made over their places, and the result has every vertex."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Indices
from ..mesh.input_checks import checked_edges, checked_faces, checked_triangulation, checked_vertices
from ..mesh.triangulation import triangulate
from ..mesh.welding import Weld, close_distances, find_copies, largest_distance, stand_apart
from ..patches.observations import checked_weights
from ..progress import Progress, Steps, relayed
from ..settings import Settings
from ..surface.metrics import statistics
from .denoised import MeshInput
from .report import Report
from .result import Approximation


@dataclass(frozen=True, eq=False)
class Welded:
    """A mesh whose coincident vertices are one, the mesh that it was made of, and whether nobody said how close."""

    mesh: MeshInput
    given: MeshInput
    weld: Weld
    triangles: Indices
    automatic: bool

    def spread(self, steps: Steps[Approximation]) -> Steps[Approximation]:
        """Give the result, and each surface on the way to it, the vertices that were given."""
        return self._result((yield from relayed(steps, self._shown)))

    def _shown(self, step: Progress) -> Progress:
        surface, place = step.surface, self.weld.place
        return step if surface is None else replace(step, surface=lambda: surface()[place])

    def _result(self, found: Approximation) -> Approximation:
        place, given = self.weld.place, np.asarray(self.given.positions)
        vertices = found.vertices[place]
        places = given[self.weld.first][place]
        away = np.linalg.norm((given - places).astype(np.float64), axis=1)
        # What the surface leaves where it is keeps its own last digits.
        stays = (vertices == places.astype(vertices.dtype)).all(axis=1)
        if not self.automatic:
            stays &= away <= close_distances(given, self.triangles, self.weld.place)
        vertices[stays] = given[stays]
        error = np.linalg.norm(vertices.astype(np.float64) - given.astype(np.float64), axis=1)
        patch = found.patch[place]
        return replace(
            found,
            vertices=vertices,
            error=error,
            patch=patch,
            measures=self._report(found, error, patch),
            history=None if found.history is None else found.history[:, place],
            creases=None if found.creases is None else self.edges(found.creases),
        )

    def _report(self, found: Approximation, error: NDArray[np.float64], patch: NDArray[np.int32]) -> Report:
        """Count and measure the vertices that were given.  No copy is farther from its place than `away`."""
        report, given = found.measures, np.asarray(self.given.positions, dtype=np.float64)
        away = np.linalg.norm(given - given[self.weld.first][self.weld.place], axis=1).max()
        at_vertices, size = statistics(error), report.input["bounding_box_longest_side"]
        between = {**report.surface_error}
        if "bound" in between:
            between["bound"] += float(away)
        relative = {"vertex_rms": at_vertices["rms"] / size, "vertex_max": at_vertices["max"] / size}
        passed = patch < 0 if report.patches else error == 0.0
        counts = {"vertices": len(given), "merged_vertices": self.weld.merged}
        return replace(
            report,
            input={**report.input, **counts},
            passed_through_vertices=int(passed.sum()),
            vertex_error=at_vertices,
            surface_error=between,
            relative={**report.relative, **relative},
        )

    def edges(self, edges: Indices) -> Indices:
        """Edges between the given vertices, (E, 2), of those between places."""
        sides = np.stack([self.triangles, np.roll(self.triangles, -1, axis=1)], axis=2).reshape(-1, 2)
        count = len(self.weld.first)
        wanted, keys = (np.sort(e, axis=1) @ np.array([count, 1]) for e in (edges, self.weld.place[sides]))
        found: Indices = np.unique(np.sort(sides[np.isin(keys, wanted)], axis=1), axis=0)
        return found


def held_together(given: MeshInput, settings: Settings) -> Welded | None:
    """Hold vertices on open borders together that lie at one place; None where there are none.

    Raises
    ------
    InputError
        When the mesh cannot be worked on.
    """
    if not settings.merge_vertices:
        return None
    points = checked_vertices(given.positions)
    if stand_apart(points, settings.merge_distance or largest_distance(np.asarray(given.positions))):
        return None
    corners, offsets = checked_faces(given.faces, len(points))
    if given.triangles is None:
        triangles, polygon = triangulate(points, corners, offsets)
    else:
        triangles, polygon = checked_triangulation(given.triangles, len(points), len(offsets) - 1)
    weld = find_copies(np.asarray(given.positions), triangles, settings.merge_distance)
    if weld is None:
        return None
    weights = checked_weights(given.weights, len(points))
    mesh = replace(
        given,
        positions=np.asarray(given.positions)[weld.first],
        faces=_polygons(weld.place[corners], offsets),
        triangles=(weld.place[triangles], polygon),
        weights=None if weights is None else weld.least(weights),
        sharp_edges=weld.place[checked_edges(given.sharp_edges, len(points))],
    )
    return Welded(mesh, given, weld, triangles, automatic=not settings.merge_distance)


def _polygons(corners: Indices, offsets: Indices) -> ArrayLike | list[NDArray[Any]]:
    sizes = np.diff(offsets)
    if (sizes == sizes[0]).all():
        return corners.reshape(len(sizes), -1)
    return np.split(corners, offsets[1:-1])

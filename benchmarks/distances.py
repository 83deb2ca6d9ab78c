"""The distances of `solver.distance` beside MeshLab's Hausdorff distance, taken from its package pymeshlab."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..solver import Settings, approximate
from ..solver.distance.distance import distance
from ..solver.distance.surfaces import Surface
from ..solver.mesh.triangle_mesh import build_mesh
from .cases import Case, generated
from .tables import Table

NOISE, TURN = 5e-3, np.radians(1.0)
"""Standard deviation of the noise at each vertex, longest sides; angle of the turn."""

SAMPLES = 500_000
"""Places on each surface, for MeshLab's figures; ours are taken at the default number."""


@dataclass(frozen=True)
class Compared:
    """Distances from one surface to another as both programs find them, scene units.

    Attributes
    ----------
    lab_max, lab_rms
        MeshLab's: the largest at vertices, on edges and faces, and the root mean square over faces.
    max, bound, rms
        Ours: the largest that was found, the length that none exceeds, and the root mean square.
    """

    model: str
    change: str
    direction: str
    lab_max: float
    max: float
    bound: float
    lab_rms: float
    rms: float


def run(cases: Sequence[Case], say: Callable[[str], None]) -> tuple[dict[str, Table], Any]:
    """Compare; returns a table, and everything as plain values."""
    try:
        import pymeshlab
    except ImportError:
        say("without pymeshlab there is nothing to compare distances with")
        return {}, None
    rows = []
    for case in cases:
        say(f"{case.model}, distances")
        for change, one, other in pairs(case):
            both = distance(one, other).report
            for direction, found, (a, b) in (
                ("there", both["a_to_b"], (one, other)),
                ("back", both["b_to_a"], (other, one)),
            ):
                largest = _of_meshlab(pymeshlab, a, b, faces_only=False)["max"]
                rms = _of_meshlab(pymeshlab, a, b, faces_only=True)["RMS"]
                ours = found["max"], found["max_bound"], found["rms"]
                rows.append(Compared(case.model, change, direction, largest, *ours[:2], rms, ours[2]))
    head = ["model", "change", "direction", "MeshLab: max", "max", "at most", "MeshLab: rms", "rms"]
    return {"distances": Table.of(head, (list(vars(row).values()) for row in rows))}, [asdict(row) for row in rows]


def pairs(case: Case) -> Iterator[tuple[str, Surface, Surface]]:
    """Yield what was done to a model, the changed surface, and the model: noise, approximation, a turn."""
    vertices, faces = case.arrays if case.arrays is not None else generated(case.model, case.size)
    mesh = build_mesh(vertices, faces)
    vertices, triangles = mesh.vertices, mesh.triangles
    model = Surface.of(vertices, triangles)
    side = float(np.ptp(vertices, axis=0).max())
    noise = np.random.default_rng(0).normal(size=vertices.shape)
    yield "noise", Surface.of(vertices + NOISE * side * noise, triangles), model
    yield "approximated", Surface.of(approximate(vertices, faces, Settings(creases="off")).vertices, triangles), model
    cosine, sine = np.cos(TURN), np.sin(TURN)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    yield "turned", Surface.of(vertices @ turn.T, triangles), model


def _of_meshlab(pymeshlab: Any, one: Surface, other: Surface, *, faces_only: bool) -> dict[str, float]:
    meshes = pymeshlab.MeshSet()
    for surface in (one, other):
        used, corners = np.unique(surface.triangles, return_inverse=True)  # MeshLab measures from loose vertices, too
        meshes.add_mesh(pymeshlab.Mesh(surface.vertices[used], corners.reshape(-1, 3)))
    found: dict[str, float] = meshes.get_hausdorff_distance(
        sampledmesh=0,
        targetmesh=1,
        samplenum=SAMPLES,
        samplevert=not faces_only,
        sampleedge=not faces_only,
        sampleface=True,
        maxdist=pymeshlab.PercentageValue(100),
    )
    return found

"""Making the Blender mesh of a result."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import bpy
import numpy as np

from ..operators.data import meshes as mesh_data
from ..operators.data.colours import ColourScale
from ..operators.data.results import create_result
from ..solver import Settings, approximate
from .cases import Case, generated, unit_seconds
from .tables import Table


def seconds(case: Case, repeats: int) -> float:
    """Seconds from a result in memory to a Blender object with mesh, attributes and representation: the median."""
    vertices, faces = case.arrays if case.arrays is not None else generated(case.model, case.size)
    faces = np.asarray(faces)
    mesh = mesh_data.create_mesh(case.model, vertices, faces.ravel(), np.full(len(faces), faces.shape[1]))
    placed = bpy.data.objects.new(case.model, mesh)
    bpy.context.scene.collection.objects.link(placed)
    source = mesh_data.read_object(placed, bpy.context.evaluated_depsgraph_get())
    # How well it fits does not matter to the time.
    result = approximate(vertices.astype(np.float32), faces, Settings(iterations=0, sweeps=0))
    times = []
    for _ in range(repeats):
        vars(result.representation).pop("stored", None)
        start = time.perf_counter()
        made = create_result(bpy.context, source, result, ColourScale(0.0, float(result.error.max())))
        times.append(time.perf_counter() - start)
        bpy.data.meshes.remove(made.data)
    return float(np.median(times))


def run(cases: Sequence[Case], say: Callable[[str], None]) -> tuple[dict[str, Table], Any]:
    """Measure each model; returns a table, and everything as plain values."""
    units = {}
    for case in cases:
        say(f"{case.model}, write-back")
        unit = unit_seconds()
        units[case.model] = 2.0 * seconds(case, 5) / (unit + unit_seconds())
    return {"write-back": Table.of(["model", "units"], units.items())}, units

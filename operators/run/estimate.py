"""Estimated patch count, run time and memory of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ...solver.native.library import reason_for_numpy
from ...solver.patch_methods import METHODS
from ...solver.settings import Settings

if TYPE_CHECKING:
    from bpy.types import Context, Object

LARGE_MESH = 300_000
"""Vertices beyond which the user is warned."""

COVER_EFFICIENCY = 0.5
"""Share of a centre's (k - 1)-ring that no other patch covers; measured on CAD parts and scans alike."""

MEGABYTES_PER_THOUSAND_VERTICES = 4.0

KERNEL_SHARE = 0.4
"""Share of NumPy's time that a run takes with the compiled kernel; measured from 0.29 to 0.43."""

_seconds_per_work = 4.0e-7
"""Of a common desktop processor; replaced by what the last run took on this machine."""


@dataclass(frozen=True)
class Estimate:
    """What to expect of a run."""

    patches: int
    seconds: float
    gigabytes: float


def estimate(vertices: int, settings: Settings) -> Estimate:
    """Estimate a run on a mesh with this number of vertices."""
    return Estimate(
        patches=0 if settings.denoise == "only" else _patches(vertices, settings.ring),
        seconds=_work(vertices, settings) * _seconds_per_work,
        gigabytes=vertices * MEGABYTES_PER_THOUSAND_VERTICES * 1e-6,
    )


def learn(report: Mapping[str, Any]) -> None:
    """Take the speed of this machine from the report of a run; runs of less than half a second say nothing."""
    global _seconds_per_work
    seconds = report["seconds"]["total"]
    if seconds > 0.5:
        _seconds_per_work = seconds / _work(report["input"]["vertices"], Settings.from_dict(report["settings"]))


def vertex_count(chosen: Object, context: Context) -> int:
    """Return the number of vertices that will be read from a mesh object; cheap enough for every redraw.

    Modifiers count as last evaluated: drawing a panel must not evaluate anything.
    """
    depsgraph = context.view_layer.depsgraph
    if context.scene.sparse_surface.use_modifiers and depsgraph is not None and chosen.mode == "OBJECT":
        return len(chosen.evaluated_get(depsgraph).data.vertices)
    return len(chosen.data.vertices)


def _patches(vertices: int, ring: int) -> int:
    inner = 1 + 3 * ring * (ring - 1)  # vertices of a (k - 1)-ring where six edges meet
    return max(1, round(vertices / (COVER_EFFICIENCY * inner)))


def _work(vertices: int, settings: Settings) -> float:
    """Floating-point work in arbitrary units: observations times functions times steps.

    Removing noise costs about as much as a default run by NumPy.
    """
    if settings.denoise == "only":
        return _work(vertices, Settings(solver="numpy"))
    if settings.denoise == "first":
        return _work(vertices, Settings(solver="numpy")) + _work(vertices, replace(settings, denoise="off"))
    overlap = (1 + 3 * settings.ring * (settings.ring + 1)) / (
        COVER_EFFICIENCY * (1 + 3 * settings.ring * (settings.ring - 1))
    )
    domains = 0.5 + 0.5 * settings.channels  # measured: three domains take about twice as long as one
    steps = METHODS[settings.method].work(settings.iterations, settings.sweeps)
    functions = settings.sparsity * (1.0 + ((settings.degree + 1) * (settings.degree + 2) / 2) / 120)
    share = KERNEL_SHARE if reason_for_numpy(settings.resolved()) is None else 1.0
    return vertices * overlap * domains * steps * functions * share

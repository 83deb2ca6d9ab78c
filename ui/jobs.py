"""The four jobs of the panel: which one is shown, and what follows from choosing one."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import EnumProperty, IntProperty
from bpy.types import Object, PropertyGroup

SOLVE, RECONSTRUCT, MEASURE = range(3)
"""What `job_chosen` holds.  Approximating and denoising are one: the setting `denoise` tells them apart."""

ITEMS = (
    ("APPROXIMATE", "Approximate", "Replace a mesh by smooth patches that keep its sharp features", "MOD_SMOOTH", 0),
    ("DENOISE", "Denoise", "Remove the noise of a scanned mesh; creases are kept", "BRUSH_DATA", 1),
    ("RECONSTRUCT", "Reconstruct", "Make a surface from points", "POINTCLOUD_DATA", 2),
    ("MEASURE", "Measure", "See how far two surfaces are apart: colours and figures", "DRIVER_DISTANCE", 3),
)


def is_points(candidate: Object | None) -> bool:
    """Whether an object is a point cloud, or a mesh of nothing but vertices."""
    if candidate is None or candidate.type not in {"MESH", "POINTCLOUD"}:
        return False
    if candidate.type == "POINTCLOUD":
        return True
    data = candidate.data
    return bool(len(data.vertices)) and not (len(data.edges) or len(data.polygons) or candidate.modifiers)


def _active() -> Object | None:
    found: Object | None = getattr(bpy.context, "active_object", None)
    return found if found is not None and found.select_get() else None


def _job(self: PropertyGroup) -> int:
    active = _active()
    if is_points(active) and active.session_uid != self.job_for:  # type: ignore[union-attr]
        return 2
    if self.job_chosen == SOLVE:
        return 0 if self.denoise == "off" else 1
    return int(self.job_chosen) + 1


def _choose_job(self: PropertyGroup, job: int) -> None:
    active = _active()
    self.job_for = active.session_uid if active is not None else 0
    self.job_chosen = max(job - 1, SOLVE)
    if job == 0:
        self.denoise = "off"
    elif job == 1 and self.denoise == "off":
        self.denoise = "only"


PROPERTIES: dict[str, Any] = {
    "job": EnumProperty(
        name="Job",
        description="What to do. Selecting points chooses Reconstruct",
        items=ITEMS,
        get=_job,
        set=_choose_job,
    ),
    "job_chosen": IntProperty(name="Chosen Job", min=SOLVE, max=MEASURE, options={"HIDDEN"}),
    "job_for": IntProperty(
        name="Chosen For",
        description="Session number of the object that was active when the job was chosen",
        options={"HIDDEN"},
    ),
}
"""Of the scene's settings."""

"""The operator that copies a result's figures to the clipboard."""

from __future__ import annotations

import json
from typing import Any

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.props import EnumProperty
from bpy.types import Context, Operator

from .data.result_keys import read_report


class SPARSE_SURFACE_OT_copy_statistics(Operator):
    """Copy the statistics of the active result to the clipboard"""

    bl_idname = "sparse_surface.copy_statistics"
    bl_label = "Copy Statistics"
    bl_options = {"INTERNAL"}

    form: EnumProperty(
        name="Form",
        description="How the statistics are written",
        items=[
            ("TEXT", "Text", "The figures of the panel, a line for each"),
            ("JSON", "JSON", "The whole report, for scripts"),
        ],
        default="TEXT",
    )

    @classmethod
    def poll(cls, context: Context) -> bool:
        if read_report(context.active_object) is None:
            cls.poll_message_set("The active object is not a result")
            return False
        return True

    def execute(self, context: Context) -> set[str]:
        report = read_report(context.active_object) or {}
        as_text = statistics_text(context.active_object.name, report)
        context.window_manager.clipboard = as_text if self.form == "TEXT" else json.dumps(report, indent=2)
        self.report({"INFO"}, rpt_("Statistics copied"))
        return {"FINISHED"}


def statistics_text(name: str, report: dict[str, Any]) -> str:
    """Return a report's figures as lines of text, lengths in scene units."""
    rows = [(label, f"{value:.6g}" if isinstance(value, float) else str(value)) for label, value in rows_of(report)]
    width = max(len(label) for label, _ in rows)
    return "\n".join([name, *(f"{label:<{width}}  {value}" for label, value in rows)])


def rows_of(report: dict[str, Any]) -> list[tuple[str, Any]]:
    """Return the figures that people ask for, with their names."""
    errors = [
        (f"{kind} error, {measure}", report[f"{kind.lower()}_error"][measure])
        for kind in ("Vertex", "Surface")
        for measure in ("rms", "mean", "p95", "max")
    ]
    return [
        ("Method", report["method"]),
        ("Vertices", report["input"]["vertices"]),
        ("Patches", report["patches"]),
        *_noise_rows(report),
        *errors,
        ("Normal error, degrees", report["normal_error_degrees"]),
        ("Flipped triangles", report["flipped_triangles"]),
        ("Largest seam", report["seam_max"]),
        ("Seconds", report["seconds"]["total"]),
    ]


def _noise_rows(report: dict[str, Any]) -> list[tuple[str, Any]]:
    if "denoise" not in report:
        return []
    noise = report["denoise"]
    rows = [("Noise taken off", noise["noise_level"]), ("Displacement, rms", noise["displacement"]["rms"])]
    if report["patches"]:
        rows.append(("Fit to the denoised, rms", noise["fit"]["surface_error"]["rms"]))
    return rows


CLASSES = (SPARSE_SURFACE_OT_copy_statistics,)

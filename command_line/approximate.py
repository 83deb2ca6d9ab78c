"""The command `approximate`."""

from __future__ import annotations

import argparse
from typing import Any

import bpy

from ..operators.data import meshes as mesh_data
from ..operators.data.colours import ColourScale
from ..operators.data.results import create_result
from ..operators.files.meshes import named, read_meshes
from ..operators.representation.domain_maps import write_domain_maps
from ..solver.job import approximate_arrays
from ..solver.progress import run_to_end
from .outputs import Made, write_outputs
from .progress import progress_display


def run(options: argparse.Namespace) -> None:
    """Approximate each mesh of the file, then write what was asked for."""
    made = []
    for source in named(read_meshes(options.input), options.object):
        read = mesh_data.read_object(source, bpy.context.evaluated_depsgraph_get())
        with progress_display(source.name) as show:
            outcome = run_to_end(approximate_arrays(read.arrays, options.settings), show)
        scale = ColourScale(0.0, float(outcome.error.max(initial=0.0)))
        result = create_result(bpy.context, read, outcome, scale)
        if options.domain_maps:
            write_domain_maps(result)
        made.append(Made(options.input, source, result, outcome.report, outcome.representation, options.resample))
        print(summary(source.name, outcome.report), flush=True)
    write_outputs(options, made)


def summary(name: str, report: dict[str, Any]) -> str:
    """Return one line about a result."""
    surface, relative = report["surface_error"], report["relative"]
    begins = f"{name}: {report['input']['vertices']} vertices, "
    ends = f", {report['seconds']['total']:.1f} s"
    if "denoise" in report:
        begins += noise_taken_off(report["denoise"])
        if not report["patches"]:
            return begins + ends
        # what the functions do to the denoised mesh
        fit, size = report["denoise"]["fit"], report["input"]["bounding_box_longest_side"]
        surface = fit["surface_error"]
        relative = {"surface_rms": surface["rms"] / size, "surface_max": surface["max"] / size}
        begins += "; fitted with "
    return (
        f"{begins}{report['patches']} patches, surface error "
        f"rms {surface['rms']:.3g} ({relative['surface_rms']:.2e} of the size), max {surface['max']:.3g} "
        f"({relative['surface_max']:.2e}){ends}"
    )


def noise_taken_off(noise: dict[str, Any]) -> str:
    """Say how much noise was taken off, from that part of a report."""
    if not noise["noise_level"]:
        return "no noise taken off"
    moved = noise["displacement"]
    return (
        f"noise of {noise['noise_level']:.3g} ({noise['relative_noise']:.0%} of the mean edge) taken off, "
        f"vertices moved by rms {moved['rms']:.3g}, max {moved['max']:.3g}"
    )

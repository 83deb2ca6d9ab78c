"""The command `compare`."""

from __future__ import annotations

import argparse

import bpy

from ..operators.data import meshes as mesh_data
from ..operators.data.colours import ColourScale
from ..operators.data.report_text import one_line
from ..operators.files.meshes import named, read_meshes, write_meshes
from ..operators.heat_map.pairs import make_pair
from ..solver.errors import InputError
from ..solver.job import approximate_arrays
from ..solver.progress import run_to_end
from .console import console
from .outputs import write_json
from .progress import progress_display


def run(options: argparse.Namespace) -> None:
    """Approximate the mesh with both presets; their errors share one colour scale."""
    found = named(read_meshes(options.input), options.object)
    if len(found) > 1:
        raise InputError(f"The file has {len(found)} meshes; name one of them with --object.")
    read = mesh_data.read_object(found[0], bpy.context.evaluated_depsgraph_get())
    done = {}
    for title, settings in options.settings.items():
        with progress_display(title) as show:
            done[title] = run_to_end(approximate_arrays(read.arrays, settings), show)
        console.say(one_line(title, done[title].report), title)
        console.detail(done[title].report)
    scale = ColourScale(0.0, max(float(result.error.max(initial=0.0)) for result in done.values()))
    pair = [(read, result) for result in done.values()]
    made = make_pair(bpy.context, pair, [title.title() for title in done], scale, beside=True)
    reports = {title: result.report for title, result in done.items()}
    if options.report is not None:
        write_json(options.report, reports)
    if options.output is not None:
        write_meshes(options.output, made)
    console.figures(reports)

"""The command `approximate`."""

from __future__ import annotations

import argparse

import bpy

from ..operators.data import meshes as mesh_data
from ..operators.data.colours import ColourScale
from ..operators.data.report_text import one_line
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
        kept = outcome.report, outcome.representation, options.resample
        made.append(Made(options.input, source, result, *kept, error_colours=options.error_colors))
        print(one_line(source.name, outcome.report), flush=True)
    write_outputs(options, made)

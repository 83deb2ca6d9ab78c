"""The command `reconstruct`."""

from __future__ import annotations

import argparse
import dataclasses

import bpy

from ..operators.data.colours import ColourScale
from ..operators.data.points import read_cloud
from ..operators.data.report_text import one_line
from ..operators.data.results import create_surface
from ..operators.files.points import create_base, read_base, read_points
from ..operators.representation.domain_maps import write_domain_maps
from ..solver.progress import run_to_end
from ..solver.reconstruction.evaluated import reconstruct_arrays
from .outputs import Made, write_outputs
from .progress import progress_display


def run(options: argparse.Namespace) -> None:
    """Make a surface from the points of the file, then write what was asked for."""
    arrays = read_base(options.base) if options.base else None
    points = read_points(options.input, options.object)
    base = create_base(*arrays, options.base.stem) if arrays else None
    source = read_cloud(bpy.context, points, base, options.base_vertices or 0, options.cloud, options.resample or 0)
    with progress_display(points.name) as show:
        outcome = run_to_end(reconstruct_arrays(source.arrays, options.settings), show)
    scale = ColourScale(0.0, float(outcome.point_error.max(initial=0.0)))
    surface = create_surface(bpy.context, source, outcome, scale)
    if options.domain_maps:
        write_domain_maps(surface)
    print(one_line(points.name, outcome.report), flush=True)
    # The surface has the resolution that was asked for already.
    made = Made(options.input, points, surface, outcome.report, outcome.representation)
    write_outputs(options, [dataclasses.replace(made, error_colours=options.error_colors)])

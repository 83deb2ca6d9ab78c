"""The command `reconstruct`."""

from __future__ import annotations

import argparse
import dataclasses

import bpy
import numpy as np

from ..operators.data.colours import ColourScale
from ..operators.data.points import read_cloud
from ..operators.data.report_text import one_line
from ..operators.data.result_keys import SHIFT
from ..operators.data.results import create_surface
from ..operators.files.formats import ONLY_PLAIN
from ..operators.files.points import create_base, read_base, read_points
from ..operators.files.shifted import SHIFTERS
from ..operators.representation.compacting import compact_drafts
from ..operators.representation.domain_maps import write_domain_maps
from ..solver.progress import run_to_end
from ..solver.reconstruction.evaluated import reconstruct_arrays
from ..solver.surface.representation import Representation
from .console import console
from .in_parts import read_large
from .outputs import Made, asked_for, is_scene, keeps_functions, write_outputs
from .progress import progress_display


def run(options: argparse.Namespace) -> None:
    """Make a surface from the points of the file, then write what was asked for."""
    arrays = read_base(options.base) if options.base else None
    large = read_large(options)
    points = read_points(options.input, options.object, shift=True) if large is None else large.points
    base = None
    if arrays:
        vertices, corners, sizes = arrays
        moved = vertices - np.array(points.get(SHIFT, (0.0, 0.0, 0.0)))
        base = create_base(moved, corners, sizes, options.base.stem)
    source = read_cloud(bpy.context, points, base, options.base_vertices or 0, options.cloud, options.resample or 0)
    with progress_display(points.name) as show:
        further = None if large is None else large.measured
        outcome = run_to_end(reconstruct_arrays(source.arrays, options.settings, further), show)
    scale = ColourScale(0.0, float(outcome.point_error.max(initial=0.0)))
    surface = create_surface(bpy.context, source, outcome, scale, keeps_functions=keeps_functions(options))
    if options.domain_maps:
        write_domain_maps(surface)
    if is_scene(options.output):
        compact_drafts()
    console.say(one_line(points.name, outcome.report), points.name)
    console.detail(outcome.report)
    _say_where(options, source.arrays.shift)
    # The surface has the resolution that was asked for already.
    made = Made(
        options.input, points, surface, outcome.report, _given_back(outcome.representation, source.arrays.shift)
    )
    write_outputs(options, [dataclasses.replace(made, **asked_for(options))])


def _given_back(representation: Representation, shift: tuple[float, float, float]) -> Representation:
    """Move a representation to where the points were in their file: it holds double precision."""
    if not any(shift):
        return representation
    vertices, origins = representation.vertices + np.array(shift), representation.origins + np.array(shift)
    return dataclasses.replace(representation, vertices=vertices, origins=origins)


def _say_where(options: argparse.Namespace, shift: tuple[float, float, float]) -> None:
    """Say that a kind of file without double precision keeps the shifted coordinates."""
    ending = options.output.suffix.lower() if options.output else ""
    if any(shift) and ending and ending not in (*SHIFTERS, *ONLY_PLAIN):
        place = " ".join(f"{value:.12g}" for value in shift)
        console.say(f"{options.output.name} holds single precision: its coordinates are relative to {place}")

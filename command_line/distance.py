"""The command `distance`."""

from __future__ import annotations

import argparse

import bpy

from ..operators.measure.reading import read_file
from ..operators.measure.showing import create_measured, create_plain, summary
from ..solver.distance.distance import distance_steps
from ..solver.progress import run_to_end
from .console import console
from .outputs import DISTANCE_OUTPUTS, Made, write_outputs
from .progress import progress_display


def run(options: argparse.Namespace) -> None:
    """Measure the distances between the surfaces of two files, then write what was asked for."""
    first, second = read_file(options.first), read_file(options.second)
    with progress_display(first.name) as show:
        measured = run_to_end(distance_steps(first.surface, second.surface, options.settings), show)
    console.say(summary(first.name, second.name, measured.report), first.name)
    bpy.ops.wm.read_homefile(use_empty=True)
    made, other = create_measured(first, measured), create_plain(second)
    shown = made if len(first.sizes) else create_measured(first, measured, visible_points=True)
    caption = f"Distance from {second.name}"
    result = Made(options.first, other, made, measured.report, None, None, measured, shown, caption)
    write_outputs(options, [result], DISTANCE_OUTPUTS)

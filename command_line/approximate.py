"""The command `approximate`."""

from __future__ import annotations

import argparse
from typing import Any

import bpy
from bpy.types import Object

from ..operators.data import meshes as mesh_data
from ..operators.data.colours import ColourScale
from ..operators.data.report_text import one_line
from ..operators.data.results import create_result
from ..operators.files.meshes import named, read_meshes
from ..operators.representation.domain_maps import write_domain_maps
from ..solver.errors import InputError, SparseSurfaceError
from ..solver.job import approximate_arrays
from ..solver.progress import run_to_end
from .arguments import PROGRAM
from .console import console
from .outputs import Made, asked_for, write_outputs
from .progress import progress_display


def run(options: argparse.Namespace) -> int:
    """Approximate each mesh of the file, then write what was asked for; a mesh that is refused does not stop the rest.

    Returns
    -------
    int
        Exit code: with `--strict` 1 where a mesh was refused.

    Raises
    ------
    SparseSurfaceError
        When nothing was made.
    """
    sources = named(read_meshes(options.input), options.object)
    made: list[Made] = []
    solved: dict[Any, Any] = {}
    refused = 0
    for source in sources:
        try:
            made.append(_approximated(options, source, solved))
        except SparseSurfaceError as error:
            if len(sources) == 1:
                raise
            refused += 1
            console.complain(f"{source.name}: {error}", PROGRAM)
    if not made:
        raise InputError(f"None of the {len(sources)} meshes of '{options.input.name}' could be approximated.")
    write_outputs(options, made)
    return int(bool(refused and options.strict))


def _approximated(options: argparse.Namespace, source: Object, solved: dict[Any, Any]) -> Made:
    """Approximate an object; objects that share a mesh are solved once."""
    read = mesh_data.read_object(source, bpy.context.evaluated_depsgraph_get())
    key = _shared(source, read)
    outcome = solved.get(key)
    if outcome is None:
        with progress_display(source.name) as show:
            outcome = run_to_end(approximate_arrays(read.arrays, options.settings), show)
    if source.data.users > 1:
        solved[key] = outcome
    scale = ColourScale(0.0, float(outcome.error.max(initial=0.0)))
    result = create_result(bpy.context, read, outcome, scale)
    if options.domain_maps:
        write_domain_maps(result)
    console.say(one_line(source.name, outcome.report), source.name)
    console.detail(outcome.report)
    kept = outcome.report, outcome.representation, options.resample
    return Made(options.input, source, result, *kept, **asked_for(options))


def _shared(source: Object, read: mesh_data.Source) -> Any:
    """Return what is equal for two objects with the same mesh in the same size."""
    if source.modifiers:
        return source.name
    stretch = read.lengths.stretch
    return source.data.name, None if stretch is None else stretch.round(9).tobytes()
